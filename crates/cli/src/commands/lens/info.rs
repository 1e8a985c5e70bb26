//! `lens info`: what a lens is: focal lengths, pupils, aberrations.

use super::bench::{Bench, Table, finish};
use super::draw::layout;
use super::{GlobalFlags, print_json};
use anyhow::anyhow;
use diopter::lens::analysis::ThirdOrder;
use diopter::lens::compound::{nearest_focus, printed_focal_lengths};
use diopter::lens::glass::GlassKind;
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::prescription::Coating;
use diopter::lens::surface::Profile;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// First-order data, Seidel sums, glasses, sources; -o draws the lens.
#[derive(clap::Args, Debug)]
pub struct Info {
    #[command(flatten)]
    bench: Bench,
}

impl Info {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let asked = &self.bench;
        let table = Table::new(asked)?;
        let (p, system) = (&table.prescription, &table.set.system);
        let n = system.indices(table.reference);
        let mut f = FirstOrder::of(system, &n);
        // The pupils of the real axial beam: aberrations of the pupil make the stop's paraxial image a little larger or smaller.
        f.stop_radius = 0.5 * table.set.efl / table.set.f_number / f.entrance_pupil_magnification.abs();
        let f = f;
        let bench = table.bench();
        let last = system.last_z();
        let ends = system.surfaces.iter().fold((0.0f64, 0.0f64), |(a, b), s| (a.min(s.z), b.max(s.z)));
        let length = ends.1 - ends.0;
        let (short, long) = match &table.wavelengths[..] {
            [only] => (*only, *only),
            all => (all.iter().copied().fold(f64::MAX, f64::min), all.iter().copied().fold(0.0, f64::max)),
        };
        let dispersion: Vec<f64> = system.indices(short).iter().zip(system.indices(long)).map(|(a, b)| a - b).collect();
        let height = 0.5 * table.set.efl / table.set.f_number;
        let third_field = table.third_order_field();
        let slope = third_field.to_radians().tan();
        let (f_number, widest) = (table.f_number(), table.set.widest * table.dispersion_of_focal_length());
        let third = ThirdOrder::of(system, &n, &dispersion, table.object_distance, height, slope);
        let axis = bench.illumination(0.0, table.reference);
        let transmittance = axis.with_losses / axis.geometric;
        if axis.geometric <= 0.0 {
            return Err(anyhow!("{}: no light reaches the middle of the film", p.name));
        }
        // As bright on the axis as a lossless, unobstructed lens of this f-number: everything that takes light counts.
        let t_number = (std::f64::consts::PI / (4.0 * axis.with_losses)).sqrt();
        let magnification = table.object_distance.map_or(0.0, |d| -f.front_focal_length() / (d + f.ffl));
        let working = (std::f64::consts::PI / (4.0 * axis.geometric)).sqrt();
        let measured = bench.measured_focal_length(table.reference);
        let glasses: Vec<String> =
            p.surfaces.iter().filter(|s| s.glass.kind != GlassKind::Air).map(|s| s.glass.describe()).collect();
        let sum = third.sum();
        // The image circle that is stated, held against the trace.
        let circle = p.image_circle.and_then(|circle| Some((circle, table.set.image_circle_radius(0.5 * circle)?)));
        if global.json {
            let by_surface: Vec<Value> = third
            .surfaces
            .iter()
            .map(|s| json!({ "seidel_mm": s.seidel, "chromatic_mm": s.chromatic, "petzval_per_mm": s.petzval, "transverse_mm": third.transverse(s) }))
            .collect();
            return print_json(&json!({
                "name": p.name, "patent": p.patent, "source": p.source, "notes": p.notes, "wavelength_nm": table.reference,
                "surfaces": p.surfaces.len(), "stop": p.stop() + 1, "zoom": p.zoom, "zoom_position": (!p.zoom.is_empty()).then_some(table.set.state.zoom + 1.0), "close_focus_mm": p.close_focus,
                "effective_focal_length_mm": f.efl, "image_index": f.image_index, "measured_focal_length_mm": measured,
                "back_focal_length_mm": f.bfl, "front_focal_length_mm": f.ffl,
                "front_principal_z_mm": f.front_principal_z, "rear_principal_z_mm": f.rear_principal_z,
                "entrance_pupil_z_mm": f.entrance_pupil_z, "entrance_pupil_diameter_mm": 2.0 * f.entrance_pupil_radius(),
                "exit_pupil_z_mm": f.exit_pupil_z, "exit_pupil_from_last_mm": f.exit_pupil_z - last, "exit_pupil_diameter_mm": 2.0 * f.exit_pupil_radius(),
                "f_number": f_number, "widest_f_number": widest, "paraxial_f_number": f.f_number(),
                "working_f_number": working, "t_number": t_number, "transmittance": transmittance,
                "magnification": magnification, "petzval_sum_per_mm": f.petzval_sum, "length_mm": length, "film_z_mm": system.film_z,
                "image_circle_mm": p.image_circle, "lit_radius_mm": circle.map(|c| c.1),
                "third_order": { "field_deg": third_field, "by_surface": by_surface, "seidel_mm": sum.seidel, "chromatic_mm": sum.chromatic, "transverse_mm": third.transverse(&sum) },
                "glasses": glasses,
            }));
        }
        let mut t = String::new();
        writeln!(t, "{}", p.name)?;
        if let Some(patent) = &p.patent {
            writeln!(t, "  patent            {patent}")?;
        }
        if !p.source.is_empty() {
            writeln!(t, "  source            {}", p.source)?;
        }
        writeln!(t, "  at                {:.1} nm, z from the first vertex", table.reference)?;
        writeln!(
            t,
            "  focal length      {:.4} mm{}",
            f.efl,
            measured.map_or(String::new(), |m| format!(", {m:.4} mm by parallel rays at 0.2°"))
        )?;
        // Of glass or water before the image.
        if (f.image_index - 1.0).abs() > 1e-3 {
            writeln!(
                t,
                "  image space       index {:.4}: 1 / power is {:.4} mm, and image heights are that times tan θ",
                f.image_index,
                f.front_focal_length()
            )?;
        }
        writeln!(t, "  back, front       {:.4} mm, {:.4} mm", f.bfl, f.ffl)?;
        writeln!(t, "  principal planes  z {:.4} and {:.4} mm", f.front_principal_z, f.rear_principal_z)?;
        writeln!(t, "  entrance pupil    z {:.4} mm, diameter {:.4} mm", f.entrance_pupil_z, 2.0 * f.entrance_pupil_radius())?;
        writeln!(
            t,
            "  exit pupil        z {:.4} mm ({:.4} from the last vertex), diameter {:.4} mm",
            f.exit_pupil_z,
            f.exit_pupil_z - last,
            2.0 * f.exit_pupil_radius()
        )?;
        writeln!(
            t,
            "  f-number          {:.4} (opens to {:.4}), working {working:.4}, T-stop {t_number:.4} (transmittance {transmittance:.4})",
            f_number, widest
        )?;
        if magnification != 0.0 {
            writeln!(t, "  magnification     {magnification:.6}")?;
        }
        writeln!(t, "  length            {length:.4} mm, film at {:.4} mm", system.film_z)?;
        if let Some((circle, lit)) = circle {
            let radius = 0.5 * circle;
            let dark = match system.dark_glass().filter(|_| lit < radius) {
                Some(glass) => format!(": {} has no index in visible light", glass.written()),
                None if lit < radius => ": the rims of the prescription stop all light beyond".into(),
                None => String::new(),
            };
            writeln!(t, "  image circle      {circle} mm stated; lit to {lit:.2} mm of {radius:.2} mm from its middle{dark}")?;
        }
        writeln!(t, "  Petzval sum       {:.6} /mm (radius {:.2} mm)", f.petzval_sum, 1.0 / f.petzval_sum)?;
        if p.coating != Coating::None {
            writeln!(t, "  coating           {}", p.coating.describe())?;
        }
        if let Some(nearest) = nearest_focus(p, table.set.state.zoom) {
            writeln!(t, "  nearest focus     {nearest:.0} mm from the entrance pupil")?;
        }
        if !p.zoom.is_empty() {
            let position = |(i, f): (usize, f64)| format!("{} ({f:.2} mm)", i + 1);
            let printed: Vec<String> = printed_focal_lengths(p).into_iter().enumerate().map(position).collect();
            writeln!(t, "  zoom positions    {}; here {:.3}", printed.join(", "), table.set.state.zoom + 1.0)?;
        }
        writeln!(t, "\n  {:>3} {:>12} {:>10} {:>9}  glass", "", "radius", "gap", "semi-dia")?;
        for (i, s) in p.surfaces.iter().enumerate() {
            let radius = match &s.profile {
                Profile::Plane => "plane".into(),
                other if other.curvature() == 0.0 && other.is_rotational() => "asphere".into(),
                Profile::Toroid { .. } | Profile::Biconic { .. } | Profile::Freeform(_) => {
                    let r = |c: f64| if c == 0.0 { "inf".to_owned() } else { format!("{:.2}", 1.0 / c) };
                    format!("{}/{}", r(s.profile.curvature_x()), r(s.profile.curvature()))
                }
                other => format!("{:.4}", 1.0 / other.curvature()),
            };
            let shape = match &s.profile {
                Profile::Freeform(_) => Some("freeform"),
                Profile::Fresnel(_) => Some("Fresnel"),
                Profile::Asphere(_) | Profile::Forbes(_) | Profile::Conic { .. } => Some("asphere"),
                _ => None,
            };
            let kinds =
                [s.stop.then_some("stop"), s.mirror.then_some("mirror"), s.diffractive.is_some().then_some("diffractive"), shape];
            let kinds: Vec<&str> = kinds.into_iter().flatten().collect();
            let kind = if kinds.is_empty() { String::new() } else { format!(" {}", kinds.join(", ")) };
            let gap = s.gap.at(table.set.state.zoom, table.set.state.focus);
            let glass = if s.glass.kind == GlassKind::Air { String::new() } else { s.glass.describe() };
            writeln!(t, "  {:>3} {radius:>12} {gap:>10.4} {:>9.3}  {glass}{kind}", i + 1, s.semi_diameter.unwrap_or(0.0))?;
        }
        if system.has_gradients() {
            writeln!(t, "\n  the lens has gradient-index media: third-order sums are not computed")?;
        }
        if system.has_diffractive() {
            writeln!(
                t,
                "\n  the lens has diffractive surfaces: third-order sums are not computed; one order of each is followed"
            )?;
        }
        if system.object_axis.is_some() {
            writeln!(
                t,
                "\n  the lens has no axis: first order is that about its base ray, the mean of both sections; third-order sums are not computed"
            )?;
        }
        if !sum.seidel.iter().all(|v| v.is_finite()) {
            return finish(asked, || layout(&table), &t, &Value::Null, false);
        }
        if !system.is_rotational() {
            writeln!(t, "\n  the lens is not round: first and third order are of its y-z section, tilts left out")?;
        }
        let note = if third_field < table.largest_field() { " (larger fields have no third-order sums)" } else { "" };
        writeln!(t, "\n  third order at f/{f_number:.2} and {third_field:.2}°, transverse, mm{note}")?;
        writeln!(
            t,
            "  {:>3} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
            "", "SA", "TCO", "TAS", "SAS", "PTB", "DST", "AX", "LAT"
        )?;
        let row = |t: &mut String, name: String, v: [f64; 8]| {
            let cells: Vec<String> = v.iter().map(|v| format!("{v:>10.6}")).collect();
            writeln!(t, "  {name:>3} {}", cells.join(" "))
        };
        for (i, s) in third.surfaces.iter().enumerate() {
            row(&mut t, format!("{}", i + 1), third.transverse(s))?;
        }
        row(&mut t, "sum".into(), third.transverse(&sum))?;
        writeln!(t, "  Seidel sums S_I..S_V {:?} mm", sum.seidel.map(|v| (v * 1e6).round() / 1e6))?;
        if p.surfaces.iter().any(|s| matches!(s.glass.kind, GlassKind::Constant(_))) {
            writeln!(t, "  constant indices: this source gives no dispersion, colour figures are 0")?;
        }
        finish(asked, || layout(&table), &t, &Value::Null, false)
    }
}
