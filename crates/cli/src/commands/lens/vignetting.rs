//! `lens vignetting`: what reaches the corners.

use super::GlobalFlags;
use super::bench::{Bench, Table, finish, is_list, no_light, over_fields};
use diopter::lens::analysis::{Illumination, PupilPoint};
use serde_json::json;
use std::fmt::Write as _;

/// Relative illumination, vignetting, and the pupils as the field sees them.
#[derive(clap::Args, Debug)]
pub struct Vignetting {
    #[command(flatten)]
    bench: Bench,
}

impl Vignetting {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
        let table = Table::new(asked)?;
        let bench = table.bench();
        let most = table.largest_field();
        let fields = over_fields(asked, most, 14)?;
        let height_of = |field: f64| bench.field_point(field, table.reference).map(|p| p.height.abs());
        let heights: Vec<f64> = match is_list(asked) {
            // The places on the film where the fields that were asked for are seen.
            true => fields.iter().filter_map(|f| height_of(*f)).collect(),
            false => {
                let height = height_of(most).unwrap_or(0.36 * table.set.efl);
                (0..=20).map(|i| height * i as f64 / 20.0).collect()
            }
        };
        let light: Vec<Illumination> = heights.iter().map(|h| bench.illumination(*h, table.reference)).collect();
        let beams: Vec<(f64, f64)> =
            fields.into_iter().filter_map(|f| Some((f, bench.vignetting(f, table.reference)?))).collect();
        let axis = bench.illumination(0.0, table.reference);
        if axis.geometric <= 0.0 {
            return Err(no_light(0.0));
        }
        let mut t = format!("{}\n", table.title("vignetting"));
        writeln!(t, "  {:>10} {:>14} {:>10} {:>14} {:>12}", "height mm", "E/L sr", "relative", "with losses", "relative")?;
        for l in &light {
            writeln!(
                t,
                "  {:>10.3} {:>14.6e} {:>10.4} {:>14.6e} {:>12.4}",
                l.height,
                l.geometric,
                l.geometric / axis.geometric,
                l.with_losses,
                l.with_losses / axis.with_losses
            )?;
        }
        writeln!(t, "  {:>10} {:>22}", "field °", "beam area, of the axis")?;
        for (f, v) in &beams {
            writeln!(t, "  {f:>10.3} {v:>22.4}")?;
        }
        let pupils: Vec<_> = table.fields.iter().filter_map(|f| bench.pupil_shape(*f, table.reference)).collect();
        writeln!(t, "  {:>10} {:>18} {:>18}", "field °", "pupil width mm", "height mm")?;
        for p in &pupils {
            let size = |axis: usize| {
                let values = p.entrance.iter().map(|p| p[axis]);
                values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
            };
            writeln!(t, "  {:>10.3} {:>18.4} {:>18.4}", p.field_deg, size(0), size(1))?;
        }
        let outline = |v: &[PupilPoint]| v.iter().map(|p| p.to_array()).collect::<Vec<_>>();
        let value = json!({
            "pupils": pupils.iter().map(|p| json!({ "field_deg": p.field_deg, "entrance_mm": outline(&p.entrance), "exit_mm": outline(&p.exit) })).collect::<Vec<_>>(),
            "illumination": light.iter().map(|l| json!({ "height_mm": l.height, "geometric_sr": l.geometric, "with_losses_sr": l.with_losses })).collect::<Vec<_>>(),
            "beam_area": beams.iter().map(|(f, v)| json!({ "field_deg": f, "relative": v })).collect::<Vec<_>>(),
        });
        finish(asked, || Illumination::plot(&table.title(""), &light, &beams, &pupils), &t, &value, global.json)
    }
}
