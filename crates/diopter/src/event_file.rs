//! Events as files of other programs: numpy, CSV, Prophesee's EVT 2.0.
//!
//! - `.npy`: a structured array with the fields of Metavision's `EventCD`, packed: x `<u2`, y `<u2`, p `<i2` (1 ON, 0 OFF), t `<i8` (µs). Format: NEP 1, version 1.0.
//! - `.csv`: `t_us,x,y,p`, one event a line.
//! - `.raw`: EVT 2.0, words of 32 bits, little-endian: bits 31–28 the type (0 OFF, 1 ON, 8 time high), of events bits 27–22 the low six bits of the time, 21–11 x, 10–0 y; of the time its
//!   upper 28 bits. Up to 2048 × 2048 pixels and 2³⁴ µs (4.7 hours). Source: Prophesee, "EVT 2.0 Format" and "RAW file format".

use crate::npy;
use diopter_sensor::events::Event;
use std::fmt::Write;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EventFormat {
    /// numpy.
    Npy,
    /// Text.
    Csv,
    /// EVT 2.0.
    Evt2,
}

/// Most pixels a side, and microseconds, that EVT 2.0 can say.
const EVT2_SIDE: usize = 2048;
const EVT2_TIME: i64 = 1 << 34;

impl EventFormat {
    /// The format by the ending of a file's name: npy, csv, raw (EVT 2.0); `None` for others.
    pub fn of(path: &std::path::Path) -> Option<EventFormat> {
        match path.extension()?.to_string_lossy().to_lowercase().as_str() {
            "npy" => Some(EventFormat::Npy),
            "csv" => Some(EventFormat::Csv),
            "raw" => Some(EventFormat::Evt2),
            _ => None,
        }
    }

    /// Whether it can hold the pixels of a sensor (columns, rows) and a film of so many seconds. Fails where EVT 2.0 has too few bits for a side or a time; the text says
    /// what it holds.
    pub fn holds(self, [width, height]: [usize; 2], seconds: f64) -> Result<(), String> {
        match self {
            EventFormat::Evt2 if width > EVT2_SIDE || height > EVT2_SIDE => {
                Err(format!("{width}x{height} pixels: expected at most {EVT2_SIDE} a side in EVT 2.0, or a .npy or .csv file"))
            }
            EventFormat::Evt2 if seconds * 1e6 >= EVT2_TIME as f64 => {
                Err(format!("{seconds} s: expected less than 17179 s in EVT 2.0, or a .npy or .csv file"))
            }
            _ => Ok(()),
        }
    }

    /// The file: events in the order of their times, stamps since `origin_s`. [`EventFormat::holds`] must hold.
    pub fn bytes(self, events: &[Event], size: [usize; 2], origin_s: f64) -> Vec<u8> {
        match self {
            EventFormat::Npy => structured(events, origin_s),
            EventFormat::Csv => csv(events, origin_s).into_bytes(),
            EventFormat::Evt2 => evt2(events, size, origin_s),
        }
    }
}

fn structured(events: &[Event], origin_s: f64) -> Vec<u8> {
    let fields = "[('x', '<u2'), ('y', '<u2'), ('p', '<i2'), ('t', '<i8')]";
    let mut out = npy::header(fields, &format!("({},)", events.len()));
    for e in events {
        out.extend_from_slice(&e.x.to_le_bytes());
        out.extend_from_slice(&e.y.to_le_bytes());
        out.extend_from_slice(&i16::from(e.on).to_le_bytes());
        out.extend_from_slice(&e.stamp_us(origin_s).to_le_bytes());
    }
    out
}

fn csv(events: &[Event], origin_s: f64) -> String {
    let mut text = "t_us,x,y,p\n".to_owned();
    for e in events {
        let _ = writeln!(text, "{},{},{},{}", e.stamp_us(origin_s), e.x, e.y, u8::from(e.on));
    }
    text
}

fn evt2(events: &[Event], [width, height]: [usize; 2], origin_s: f64) -> Vec<u8> {
    let header = format!("% evt 2.0\n% format EVT2;height={height};width={width}\n% geometry {width}x{height}\n% end\n");
    let mut out = header.into_bytes();
    let mut high = None;
    for e in events {
        let t = e.stamp_us(origin_s).clamp(0, EVT2_TIME - 1) as u64;
        if high != Some(t >> 6) {
            high = Some(t >> 6);
            out.extend_from_slice(&(0x8000_0000u32 | (t >> 6) as u32).to_le_bytes());
        }
        let word = (u32::from(e.on) << 28) | ((t & 63) as u32) << 22 | u32::from(e.x) << 11 | u32::from(e.y);
        out.extend_from_slice(&word.to_le_bytes());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn events() -> Vec<Event> {
        [(1.25e-6, 3, 5, true), (64.5e-6, 2047, 0, false), (64.9e-6, 0, 2047, true), (1.0, 1, 2, false)]
            .map(|(t, x, y, on)| Event { time_s: 10.0 + t, x, y, on })
            .to_vec()
    }

    #[test]
    fn evt2_is_decoded_by_its_specification() {
        let bytes = EventFormat::Evt2.bytes(&events(), [2048, 2048], 10.0);
        let end = bytes.windows(6).position(|w| w == b"% end\n").unwrap() + 6;
        let (mut high, mut found) = (0u64, Vec::new());
        for word in bytes[end..].chunks_exact(4) {
            let w = u32::from_le_bytes(word.try_into().unwrap());
            match w >> 28 {
                8 => high = u64::from(w & 0x0fff_ffff),
                p => found.push(((high << 6) | u64::from((w >> 22) & 63), (w >> 11) & 2047, w & 2047, p)),
            }
        }
        assert_eq!(found, [(1, 3, 5, 1), (64, 2047, 0, 0), (64, 0, 2047, 1), (1_000_000, 1, 2, 0)]);
        // Three times are said: 0, 1 and 15625 of 64 µs.
        assert_eq!((bytes.len() - end) / 4, 4 + 3);
        assert!(EventFormat::Evt2.holds([2049, 5], 1.0).is_err() && EventFormat::Evt2.holds([5, 5], 2e4).is_err());
    }

    #[test]
    fn numpy_and_text_hold_the_same() {
        let bytes = EventFormat::Npy.bytes(&events(), [2048, 2048], 10.0);
        assert!((bytes.len() - 4 * 14).is_multiple_of(64));
        assert_eq!(&bytes[bytes.len() - 14..], [1, 0, 2, 0, 0, 0, 0x40, 0x42, 0x0f, 0, 0, 0, 0, 0]);
        assert_eq!(csv(&events(), 10.0), "t_us,x,y,p\n1,3,5,1\n64,2047,0,0\n64,0,2047,1\n1000000,1,2,0\n");
    }
}
