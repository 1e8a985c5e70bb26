//! JPEG with a gain map: an ordinary picture, and beside it how much brighter each place is on a display that can do more.
//!
//! Sources: ISO 21496-1 (metadata and its binary form), Adobe's gain map specification 1.0 (XMP, namespace hdrgm), Android's Ultra HDR image format 1.1
//! (the order of the parts), CIPA DC-007 (multi-picture format). The map is grey, and as fine as small highlights need.

use crate::jpeg::{self, Segment};
use crate::picture::in_bands;
use crate::{Encoding, ImageError, PictureSource};
use jpeg_encoder::{ColorType, Encoder};
use std::io::Write;

/// Pixels a side of a picture for one of its map: of what is small each counts. A highlight within one of the map is as bright as the mean around it.
fn shrink([width, height]: [usize; 2]) -> usize {
    match width.max(height) {
        0..=1024 => 1,
        1025..=2048 => 2,
        _ => 4,
    }
}

/// Added to both renditions before their ratio: black has no gain. Adobe's default.
const OFFSET: f32 = 1.0 / 64.0;
/// Quality of the map.
const MAP_QUALITY: u8 = 90;

const XMP: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
const ISO: &[u8] = b"urn:iso:std:iso:ts:21496:-1\0";

/// Writes `sdr` with the map that makes `hdr` of it; both have one size and space. `hdr` may have any encoding that tells light above white. `quality`:
/// 1 to 100. Fails where sizes differ, on sides that no JPEG has, on more than 4 GB, and where writing does; spaces are not compared.
pub fn write(sdr: &dyn PictureSource, hdr: &dyn PictureSource, quality: u8, mut to: impl Write) -> Result<(), ImageError> {
    write_to(sdr, hdr, quality, &mut to)
}

fn write_to(sdr: &dyn PictureSource, hdr: &dyn PictureSource, quality: u8, to: &mut dyn Write) -> Result<(), ImageError> {
    let map = Map::new(sdr, hdr)?;
    let secondary = map.file()?;
    // The index of pictures needs the length of the first, which has it inside: zeros first, then the length.
    let iso = [ISO, &[0, 0, 0, 0]].concat();
    let segments = |first: u32, second_at: u32| -> Vec<Segment> {
        vec![
            (1, [XMP, primary_xmp(secondary.len()).as_bytes()].concat()),
            (2, iso.clone()),
            (2, index(first, secondary.len() as u32, second_at)),
        ]
    };
    let mut primary = Vec::new();
    jpeg::write_with(sdr, quality, segments(0, 0), &mut primary)?;
    let place = primary.windows(4).position(|w| w == b"MPF\0").ok_or_else(|| other("the index of pictures is missing"))?;
    let length = u32::try_from(primary.len()).map_err(|_| other("a JPEG of more than 4 GB"))?;
    // Offsets count from the byte order behind the name.
    let filled = index(length, secondary.len() as u32, length - (place as u32 + 4));
    primary[place..place + filled.len()].copy_from_slice(&filled);
    to.write_all(&primary)?;
    Ok(to.write_all(&secondary)?)
}

fn other(text: &str) -> ImageError {
    ImageError::Io(std::io::Error::other(text.to_owned()))
}

/// log2 gains of the shrunk picture.
struct Map {
    size: [usize; 2],
    gains: Vec<f32>,
    /// Smallest and largest.
    range: [f32; 2],
}

impl Map {
    fn new(sdr: &dyn PictureSource, hdr: &dyn PictureSource) -> Result<Map, ImageError> {
        let [width, height] = sdr.size();
        if hdr.size() != [width, height] || width == 0 || height == 0 {
            return Err(ImageError::Mismatch("the two renditions of a gain map have different sizes".into()));
        }
        let shrink = shrink([width, height]);
        let (w, h) = (width.div_ceil(shrink), height.div_ceil(shrink));
        let mut gains = Vec::with_capacity(w * h);
        let weights = sdr.space().luminance_weights();
        let luminance = |codes: [f32; 3], e: Encoding| -> f32 {
            e.decode_pixel(codes, weights).iter().zip(weights).map(|(v, w)| v * w).sum()
        };
        let band = |first: usize, count: usize| {
            let (a, b) = (sdr.rows(first, count), hdr.rows(first, count));
            let (ea, eb) = (sdr.encoding(), hdr.encoding());
            let mut sums = vec![(0.0f32, 0.0f32); w * count.div_ceil(shrink)];
            for (i, (p, q)) in a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0).enumerate() {
                let (s, h) = (luminance(*p, ea), luminance(*q, eb));
                let cell = &mut sums[i / width / shrink * w + i % width / shrink];
                cell.0 += ((h.max(0.0) + OFFSET) / (s.max(0.0) + OFFSET)).log2();
                cell.1 += 1.0;
            }
            Ok(sums.iter().map(|(sum, n)| sum / n.max(1.0)).collect::<Vec<f32>>())
        };
        let rows = sdr.rows_at_once().next_multiple_of(shrink);
        in_bands(height, rows, band, |part| {
            gains.extend(part);
            Ok(())
        })?;
        let low = gains.iter().copied().fold(0.0, f32::min);
        let high = gains.iter().copied().fold(low + 0.01, f32::max);
        Ok(Map { size: [w, h], gains, range: [low, high] })
    }

    /// The map as a JPEG with its metadata.
    fn file(&self) -> Result<Vec<u8>, ImageError> {
        let [low, high] = self.range;
        let codes: Vec<u8> = self.gains.iter().map(|g| ((g - low) / (high - low) * 255.0 + 0.5) as u8).collect();
        let side = |n: usize| u16::try_from(n).map_err(|_| other("a gain map has 65 535 pixels a side at most"));
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, MAP_QUALITY);
        let io = |e: jpeg_encoder::EncodingError| ImageError::Io(std::io::Error::other(e));
        encoder.add_app_segment(1, [XMP, self.xmp().as_bytes()].concat()).map_err(io)?;
        encoder.add_app_segment(2, [ISO, &self.binary()].concat()).map_err(io)?;
        encoder.encode(&codes, side(self.size[0])?, side(self.size[1])?, ColorType::Luma).map_err(io)?;
        Ok(file)
    }

    fn xmp(&self) -> String {
        let [low, high] = self.range;
        format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
             <rdf:Description rdf:about=\"\" xmlns:hdrgm=\"http://ns.adobe.com/hdr-gain-map/1.0/\" hdrgm:Version=\"1.0\" \
             hdrgm:GainMapMin=\"{low}\" hdrgm:GainMapMax=\"{high}\" hdrgm:Gamma=\"1\" hdrgm:OffsetSDR=\"{OFFSET}\" \
             hdrgm:OffsetHDR=\"{OFFSET}\" hdrgm:HDRCapacityMin=\"0\" hdrgm:HDRCapacityMax=\"{}\" \
             hdrgm:BaseRenditionIsHDR=\"False\"/></rdf:RDF></x:xmpmeta>",
            high.max(0.01)
        )
    }

    /// The same by ISO 21496-1: one channel, colours of the base.
    fn binary(&self) -> Vec<u8> {
        const DENOMINATOR: u32 = 1 << 16;
        let fraction = |v: f32| -> [u8; 8] {
            let mut bytes = [0; 8];
            bytes[..4].copy_from_slice(&((v * DENOMINATOR as f32).round() as i32).to_be_bytes());
            bytes[4..].copy_from_slice(&DENOMINATOR.to_be_bytes());
            bytes
        };
        let [low, high] = self.range;
        // Versions, flags (0x40: the gains are in the colours of the base).
        let mut bytes = vec![0, 0, 0, 0, 0x40];
        for v in [0.0, high.max(0.01), low, high, 1.0, OFFSET, OFFSET] {
            bytes.extend(fraction(v));
        }
        bytes
    }
}

fn primary_xmp(map_length: usize) -> String {
    format!(
        "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
         <rdf:Description rdf:about=\"\" xmlns:Container=\"http://ns.google.com/photos/1.0/container/\" \
         xmlns:Item=\"http://ns.google.com/photos/1.0/container/item/\" xmlns:hdrgm=\"http://ns.adobe.com/hdr-gain-map/1.0/\" \
         hdrgm:Version=\"1.0\"><Container:Directory><rdf:Seq>\
         <rdf:li rdf:parseType=\"Resource\"><Container:Item Item:Semantic=\"Primary\" Item:Mime=\"image/jpeg\"/></rdf:li>\
         <rdf:li rdf:parseType=\"Resource\"><Container:Item Item:Semantic=\"GainMap\" Item:Mime=\"image/jpeg\" \
         Item:Length=\"{map_length}\"/></rdf:li></rdf:Seq></Container:Directory></rdf:Description></rdf:RDF></x:xmpmeta>"
    )
}

/// The index of two pictures (CIPA DC-007): big-endian, one directory of three entries.
fn index(first: u32, second: u32, second_at: u32) -> Vec<u8> {
    let mut bytes = b"MPF\0MM\0\x2a\0\0\0\x08\0\x03".to_vec();
    let mut entry = |tag: u16, kind: u16, count: u32, value: [u8; 4]| {
        bytes.extend(tag.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend(count.to_be_bytes());
        bytes.extend(value);
    };
    entry(0xb000, 7, 4, *b"0100");
    entry(0xb001, 4, 1, 2u32.to_be_bytes());
    // Behind the directory: 8 + 2 + 3 · 12 + 4.
    entry(0xb002, 7, 32, 50u32.to_be_bytes());
    bytes.extend([0; 4]);
    // The first is the representative one, a baseline primary picture.
    for (kind, size, at) in [(0x0003_0000u32, first, 0), (0, second, second_at)] {
        bytes.extend(kind.to_be_bytes());
        bytes.extend(size.to_be_bytes());
        bytes.extend(at.to_be_bytes());
        bytes.extend([0; 4]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Picture, Raster};
    use diopter_light::color::RgbSpace;

    #[test]
    fn both_pictures_are_found_and_the_gains_come_back() {
        // Pixels a side for one of the map.
        for (w, side) in [(160, 1), (1200, 2), (2400, 4)] {
            let (h, across) = (96, w / side);
            let light = |x: usize| 0.02 + 4.0 * (x as f32 / w as f32).powi(3);
            let picture = |encoding: Encoding, top: f32| {
                let mut pixels = Raster::new(w, h, 3);
                for (i, p) in pixels.data.chunks_mut(3).enumerate() {
                    p.fill(encoding.encode(light(i % w).min(top)));
                }
                Picture { pixels, space: RgbSpace::Srgb, encoding, facts: None }
            };
            let (sdr, hdr) = (picture(Encoding::Srgb, 1.0), picture(Encoding::Pq, 4.926));
            let mut file = Vec::new();
            write(&sdr, &hdr, 95, &mut file).unwrap();
            // By the index.
            let place = file.windows(4).position(|b| b == b"MPF\0").unwrap() + 4;
            let number = |at: usize| u32::from_be_bytes(file[place + at..place + at + 4].try_into().unwrap()) as usize;
            let (first, second, at) = (number(54), number(70), number(74));
            assert_eq!(first + second, file.len());
            assert_eq!(place + at, first);
            assert_eq!(file[first..first + 2], [0xff, 0xd8]);
            let text = String::from_utf8_lossy(&file);
            assert!(text.contains(&format!("Item:Length=\"{second}\"")));
            let value = |name: &str| -> f32 { text.split(name).nth(1).unwrap()[2..].split('"').next().unwrap().parse().unwrap() };
            let (low, high) = (value("hdrgm:GainMapMin"), value("hdrgm:GainMapMax"));
            let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(&file[first..]));
            let map = decoder.decode().unwrap();
            let channels = map.len() / (across * h.div_ceil(side));
            for x in 1..across - 1 {
                let gain = low + (high - low) * f32::from(map[(5 * across + x) * channels]) / 255.0;
                let here = light(side * x + side / 2);
                let expected = ((here + OFFSET) / (here.min(1.0) + OFFSET)).log2();
                assert!((gain - expected).abs() < 0.12, "{w}, {x}: {gain} {expected}");
            }
            let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(&file[..first]));
            assert_eq!(decoder.decode().unwrap().len(), w * h * 3);
        }
    }
}
