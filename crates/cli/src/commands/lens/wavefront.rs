//! `lens wavefront`: the wavefront that makes the image of a point.

use super::GlobalFlags;
use super::bench::{Bench, Table, no_light};
use super::image_files::{Files, Plane, channel, finished};
use crate::UsageError;
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::analysis;
use diopter::lens::analysis::zernike::{Fit, Numbering};
use serde_json::json;
use std::fmt::Write as _;

/// Wavefront: peak to valley, root mean square, Zernike coefficients; -o also writes maps as .exr.
#[derive(clap::Args, Debug)]
pub struct Wavefront {
    #[command(flatten)]
    bench: Bench,
    /// Order of the Zernike terms.
    #[arg(long, value_name = "ORDER", default_value = "noll")]
    zernikes: ZernikeOrder,
    /// How many of them.
    #[arg(long, value_name = "N", default_value_t = 37)]
    terms: usize,
    /// Rays across the pupil.
    #[arg(long, value_name = "N", default_value_t = 64)]
    rays: usize,
}

/// Order and normalisation of Zernike terms.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZernikeOrder {
    /// Noll's: every term has the root mean square 1.
    Noll,
    /// Fringe: every term is 1 at the edge.
    Fringe,
}

impl Wavefront {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let (asked, terms, rays) = (&self.bench, self.terms, self.rays);
        let numbering = match self.zernikes {
            ZernikeOrder::Noll => Numbering::Noll,
            ZernikeOrder::Fringe => Numbering::Fringe,
        };
        if !(1..=numbering.largest()).contains(&terms) {
            return Err(UsageError(anyhow!("terms {terms}: expected 1 to {} of this order", numbering.largest())).into());
        }
        if !(8..=512).contains(&rays) {
            return Err(UsageError(anyhow!("rays {rays}: expected 8 to 512 across the pupil")).into());
        }
        let table = Table::new(asked)?;
        let files = Files::prepare(asked)?;
        table.warn_of_ideal_paths();
        let bench = table.bench();
        let fields = table.fields.iter().flat_map(|f| table.wavelengths.iter().map(|nm| (*f, *nm)));
        let found: Vec<(analysis::Wavefront, Option<Fit>)> = fields
            .filter_map(|(field, nm)| bench.wavefront(field, nm, rays))
            .map(|w| {
                let fit = w.zernikes(numbering, terms);
                (w, fit)
            })
            .collect();
        if found.is_empty() {
            return Err(no_light(table.fields[0]));
        }
        let mut t = format!("{}\n", table.title("wavefronts, waves"));
        writeln!(
            t,
            "  {:>7} {:>8} {:>14} {:>10} {:>14} {:>12} {:>7}",
            "field °", "nm", "peak-to-valley", "rms", "rms, no tilt", "fit leaves", "rays"
        )?;
        let cell = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.5}"));
        let mut values = vec![];
        for (w, fit) in &found {
            let (flat, left) = (w.rms_without_tilt(), fit.as_ref().map(|f| f.residual_rms));
            writeln!(
                t,
                "  {:>7.2} {:>8.1} {:>14.5} {:>10.5} {:>14} {:>12} {:>7}",
                w.field_deg,
                w.nm,
                w.peak_to_valley(),
                w.rms(),
                cell(flat),
                cell(left),
                w.samples.len()
            )?;
            values.push(json!({ "field_deg": w.field_deg, "wavelength_nm": w.nm, "peak_to_valley_waves": w.peak_to_valley(), "rms_waves": w.rms(),
            "rms_without_tilt_waves": flat, "order": if numbering == Numbering::Noll { "noll" } else { "fringe" },
            "zernikes_waves": fit.as_ref().map(|f| &f.coefficients), "residual_rms_waves": left,
            "samples": w.samples.iter().map(|s| json!([s.pupil.x, s.pupil.y, s.opd])).collect::<Vec<_>>() }));
            if fit.is_none() {
                say(&format!("note: field {}°, {} nm: too few rays pass to fit {terms} terms", w.field_deg, w.nm));
            }
        }
        let name = if numbering == Numbering::Noll { "Noll" } else { "fringe" };
        let heads: String =
            found.iter().map(|(w, _)| format!(" {:>16}", format!("{:.2}° {:.0} nm", w.field_deg, w.nm))).collect();
        writeln!(t, "  {name:>6} {:>3} {:>3}{heads}", "n", "m")?;
        for (i, term) in (1..=terms).filter_map(|number| numbering.term(number)).enumerate() {
            let cells: String =
                found.iter().map(|(_, fit)| format!(" {:>16}", cell(fit.as_ref().map(|f| f.coefficients[i])))).collect();
            writeln!(t, "  {:>6} {:>3} {:>3}{cells}  {}", term.number, term.n, term.m, term.name())?;
        }
        let planes: Vec<Plane> = found.iter().map(|(w, _)| (channel("opd", w.field_deg, w.nm, 0.0), w.map())).collect();
        let plot = || {
            let label = |w: &analysis::Wavefront| format!("{:.1}° {:.0} nm", w.field_deg, w.nm);
            let curves: Vec<(String, &Fit)> = found.iter().filter_map(|(w, fit)| Some((label(w), fit.as_ref()?))).collect();
            Fit::plot(&table.title(&format!("Zernike coefficients, {name}")), &curves)
        };
        files.write(rays, &planes, plot)?;
        finished(&t, &json!(values), global.json)
    }
}
