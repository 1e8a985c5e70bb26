//! `body list` and `body info`.

use super::print_json;
use crate::args::BodyVerb;
use diopter::sensor::{Sensor, format};
use diopter::shot::read_body;
use std::fmt::Write as _;
use std::io::Write;

pub fn run(verb: &BodyVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        BodyVerb::List => list(json),
        BodyVerb::Info { body } => info(body, json),
    }
}

fn list(json: bool) -> anyhow::Result<()> {
    let bodies = Sensor::names().map(|n| Ok((n, Sensor::named(n)?))).collect::<anyhow::Result<Vec<_>>>()?;
    if json {
        let all: Vec<_> = bodies
            .iter()
            .map(|(key, s)| serde_json::json!({ "name": key, "body": s.name, "format_mm": s.format_mm, "pixels": s.pixels }))
            .collect();
        return print_json(&serde_json::json!(all));
    }
    for (key, s) in bodies {
        let [w, h] = s.format_mm;
        writeln!(std::io::stdout(), "{key:<18} {:<34} {w} × {h} mm, {} × {} pixels", s.name, s.pixels[0], s.pixels[1])?;
    }
    Ok(())
}

fn info(name: &str, json: bool) -> anyhow::Result<()> {
    let s = read_body(name)?;
    let [pitch_x, pitch_y] = s.pitch_mm().map(|p| p * 1000.0);
    let crop = format::FULL_FRAME_DIAGONAL_MM / s.format_mm[0].hypot(s.format_mm[1]);
    // What limits the top: the well or the converter.
    let full_scale = |gain: f64| ((s.white_level_dn - s.black_level_dn) * gain).min(s.full_well_e);
    let rows: Vec<_> = s
        .iso
        .iter()
        .map(|i| {
            let top = full_scale(i.gain_e_per_dn);
            // Quantisation is part of the floor.
            let floor = (i.read_noise_e.powi(2) + i.gain_e_per_dn.powi(2) / 12.0).sqrt();
            (i, top, (top / floor).log2(), 10.0 * top.log10())
        })
        .collect();
    if json {
        let iso: Vec<_> = rows
            .iter()
            .map(|(i, top, dr, snr)| {
                serde_json::json!({
                    "iso": i.iso, "gain_e_per_dn": i.gain_e_per_dn, "read_noise_e": i.read_noise_e, "saturation_e": top,
                    "dynamic_range_stops": dr, "snr_max_db": snr,
                })
            })
            .collect();
        let qe: Vec<_> = s.quantum_efficiency.iter().map(|q| q.max()).collect();
        return print_json(&serde_json::json!({
            "name": s.name, "format_mm": s.format_mm, "pixels": s.pixels, "pitch_um": [pitch_x, pitch_y], "crop_factor": crop,
            "channels": s.channel_names(), "peak_quantum_efficiency": qe, "full_well_e": s.full_well_e, "adc_bits": s.adc_bits,
            "black_level_dn": s.black_level_dn, "white_level_dn": s.white_level_dn, "iso": iso, "sources": s.sources,
        }));
    }
    let mut t = String::new();
    writeln!(t, "{}", s.name)?;
    writeln!(t, "  format        {} × {} mm, crop {crop:.3}", s.format_mm[0], s.format_mm[1])?;
    writeln!(t, "  pixels        {} × {}, pitch {pitch_x:.3} × {pitch_y:.3} µm", s.pixels[0], s.pixels[1])?;
    let qe: Vec<String> =
        s.channel_names().iter().zip(&s.quantum_efficiency).map(|(n, q)| format!("{n} {:.2}", q.max())).collect();
    writeln!(t, "  peak QE       {}", qe.join("  "))?;
    writeln!(t, "  full well     {:.0} e-", s.full_well_e)?;
    writeln!(t, "  converter     {} bit, black {} DN, white {} DN", s.adc_bits, s.black_level_dn, s.white_level_dn)?;
    writeln!(
        t,
        "  {:>7} {:>11} {:>11} {:>13} {:>13} {:>9}",
        "ISO", "gain e-/DN", "read e-", "saturation e-", "range stops", "SNR dB"
    )?;
    for (i, top, dr, snr) in rows {
        writeln!(
            t,
            "  {:>7.0} {:>11.4} {:>11.2} {:>13.0} {:>13.2} {:>9.1}",
            i.iso, i.gain_e_per_dn, i.read_noise_e, top, dr, snr
        )?;
    }
    writeln!(t, "  sources")?;
    for (what, source) in &s.sources {
        writeln!(t, "    {what}: {source}")?;
    }
    write!(std::io::stdout(), "{t}")?;
    Ok(())
}
