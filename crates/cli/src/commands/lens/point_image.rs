//! `lens psf` and `lens wavefront`: the image of a point and the wavefront that makes it.

use super::{Table, no_light, print_json};
use crate::args::{Bench as Asked, ZernikeOrder};
use crate::output::Output;
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::image::{ExposureFacts, exr};
use diopter::lens::analysis::zernike::{Fit, Numbering};
use diopter::lens::analysis::{PointImageCurves, Psf, Wavefront};
use diopter::lens::draw::Figure;
use glam::DVec2;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;

/// Largest images that are written, pixels across.
const MOST_PIXELS: usize = 2048;
/// Radii of the curve of encircled energy.
const RADII: usize = 96;

/// What is asked of the images.
pub(super) struct Psfs {
    /// Planes behind the film, mm.
    pub defocus: Vec<f64>,
    pub pixel_um: Option<f64>,
    pub pixels: Option<usize>,
    pub geometric: bool,
}

/// A plane of an EXR file.
type Plane = (String, Vec<f32>);

/// Files that were asked for: drawings, and rasters with a channel each.
struct Files {
    drawings: Vec<(bool, Output)>,
    rasters: Vec<Output>,
}

impl Files {
    fn prepare(asked: &Asked) -> anyhow::Result<Files> {
        let is_exr = |p: &&PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let (rasters, drawings): (Vec<&PathBuf>, Vec<&PathBuf>) = asked.output.iter().partition(is_exr);
        let unknown =
            |p: &&&PathBuf| !p.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg") || e.eq_ignore_ascii_case("png"));
        if let Some(bad) = drawings.iter().find(unknown) {
            return Err(UsageError(anyhow!("{}: expected a name that ends in .svg, .png or .exr", bad.display())).into());
        }
        let rasters = rasters.into_iter().map(|p| Output::prepare(p)).collect::<anyhow::Result<_>>()?;
        let drawings: Vec<PathBuf> = drawings.into_iter().cloned().collect();
        Ok(Files { drawings: paint::prepare(&drawings)?, rasters })
    }

    fn write(self, side: usize, planes: &[Plane], figure: impl FnOnce() -> Figure) -> anyhow::Result<()> {
        if !self.drawings.is_empty() {
            paint::write(self.drawings, &figure())?.iter().for_each(|p| say(&format!("wrote {}", p.display())));
        }
        let facts = ExposureFacts { software: concat!("diopter ", env!("CARGO_PKG_VERSION")).into(), ..ExposureFacts::default() };
        for output in self.rasters {
            let floats = planes.iter().map(|(name, values)| (name.as_str(), values.clone())).collect();
            let path = output.commit(|w| Ok(exr::write_planes([side; 2], floats, vec![], &facts, w)?))?;
            say(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// Name of a channel: a dot in it would start a layer.
fn channel(kind: &str, field: f64, nm: f64, defocus: f64) -> String {
    let plane = if defocus == 0.0 { String::new() } else { format!(" {defocus:+}mm") };
    format!("{kind} {field:.3}deg {nm:.1}nm{plane}").replace('.', "_")
}

/// Radius (mm) that holds a fraction of the light, between the points of a curve; not a number where it does not reach it.
fn radius_of(radii: &[f64], energy: &[f64], fraction: f64) -> f64 {
    let Some(i) = energy.iter().position(|e| *e >= fraction) else { return f64::NAN };
    if i == 0 {
        return radii[0];
    }
    radii[i - 1] + (radii[i] - radii[i - 1]) * (fraction - energy[i - 1]) / (energy[i] - energy[i - 1])
}

/// What is kept of an image: its file's part and its curves.
struct Image {
    psf: Psf,
    radii: Vec<f64>,
    energy: Vec<f64>,
    line: [Vec<f64>; 2],
    edge: [Vec<f64>; 2],
    places: Vec<f64>,
    raster: Vec<f32>,
}

pub(super) fn psf(asked: &Asked, wanted: &Psfs, json: bool) -> anyhow::Result<()> {
    if let Some(bad) = wanted.pixel_um.filter(|p| !(*p >= 1e-3 && *p <= 1000.0)) {
        return Err(UsageError(anyhow!("pixel {bad} µm: expected 0.001 to 1000")).into());
    }
    if let Some(bad) = wanted.pixels.filter(|n| !(8..=MOST_PIXELS).contains(n)) {
        return Err(UsageError(anyhow!("pixels {bad}: expected 8 to {MOST_PIXELS} across")).into());
    }
    let table = Table::new(asked)?;
    let files = Files::prepare(asked)?;
    let bench = table.bench();
    let each: Vec<(f64, f64)> = table.fields.iter().flat_map(|f| table.wavelengths.iter().map(|nm| (*f, *nm))).collect();
    // One size of pixel for all images: the finest that one of them needs.
    let needed =
        each.iter().filter_map(|(f, nm)| bench.largest_psf_pixel(*f, *nm, table.reference)).fold(f64::INFINITY, f64::min);
    if !needed.is_finite() {
        return Err(no_light(table.fields[0]));
    }
    let pixel = match wanted.pixel_um.map(|um| 1e-3 * um) {
        Some(pixel) if !wanted.geometric && pixel > needed => {
            let most = 1e3 * needed;
            let what = anyhow!("pixel {} µm: expected at most {most:.4} µm, half the period of the finest detail", 1e3 * pixel);
            return Err(UsageError(what).into());
        }
        Some(pixel) => pixel,
        None => 0.5 * needed,
    };
    // Half an image holds three times the spot and ten rings of a perfect lens, whose rings are two of the needed pixels apart.
    let spots = |plane: f64| {
        let spot = |(f, nm): &(f64, f64)| bench.spot(*f, *nm, table.reference, 32, plane);
        each.iter().filter_map(spot).map(|s| s.rms).fold(0.0, f64::max)
    };
    let widest = wanted.defocus.iter().map(|d| spots(*d)).fold(0.0, f64::max);
    let side = wanted.pixels.unwrap_or_else(|| {
        let half = (3.0 * widest + 20.0 * needed) / pixel;
        (2 * (half.ceil() as usize + 4)).min(MOST_PIXELS)
    });
    let mut images = vec![];
    for (field, nm) in &each {
        for plane in &wanted.defocus {
            let colors = [*nm, table.reference];
            let found = match wanted.geometric {
                true => bench.geometric_psf(*field, colors, *plane, pixel, side),
                false => bench.diffraction_psf(*field, colors, *plane, pixel),
            };
            images.extend(found.map(|psf| curves(psf, side)));
        }
    }
    if images.is_empty() {
        return Err(no_light(table.fields[0]));
    }
    let mut t = format!("{}\n", table.title(&format!("images of a point, pixels of {:.4} µm", 1e3 * pixel)));
    writeln!(
        t,
        "  {:>7} {:>8} {:>10} {:>8} {:>9} {:>9} {:>9} {:>10}  kind",
        "field °", "nm", "defocus mm", "Strehl", "50 % µm", "80 % µm", "90 % µm", "chief y mm"
    )?;
    let cell = |v: f64, digits: usize| if v.is_finite() { format!("{v:.digits$}") } else { "-".into() };
    let mut values = vec![];
    for image in &images {
        let psf = &image.psf;
        let radius = [0.5, 0.8, 0.9].map(|fraction| radius_of(&image.radii, &image.energy, fraction));
        let kind = if psf.geometric { "geometric" } else { "diffraction" };
        writeln!(
            t,
            "  {:>7.2} {:>8.1} {:>10.4} {:>8} {:>9} {:>9} {:>9} {:>10.5}  {kind}",
            psf.field_deg,
            psf.nm,
            psf.defocus,
            cell(psf.strehl.unwrap_or(f64::NAN), 4),
            cell(1e3 * radius[0], 3),
            cell(1e3 * radius[1], 3),
            cell(1e3 * radius[2], 3),
            psf.origin.y
        )?;
        values.push(json!({ "field_deg": psf.field_deg, "wavelength_nm": psf.nm, "defocus_mm": psf.defocus, "kind": kind, "strehl": psf.strehl,
            "pixel_mm": psf.pixel, "chief_mm": psf.origin.to_array(), "centroid_mm": (psf.origin + psf.centroid).to_array(),
            "radius_50_80_90_mm": radius, "radius_mm": image.radii, "encircled_energy": image.energy, "place_mm": image.places,
            "line_spread_per_mm": { "tangential": image.line[0], "sagittal": image.line[1] },
            "edge_spread": { "tangential": image.edge[0], "sagittal": image.edge[1] } }));
    }
    let planes: Vec<Plane> =
        images.iter().map(|i| (channel("psf", i.psf.field_deg, i.psf.nm, i.psf.defocus), i.raster.clone())).collect();
    files.write(side, &planes, || PointImageCurves::plot(&table.title(""), &images.iter().map(plotted).collect::<Vec<_>>()))?;
    finished(&t, &json!(values), json)
}

/// Measures an image and keeps the middle of it.
fn curves(mut psf: Psf, side: usize) -> Image {
    let most = 0.5 * side.min(psf.side) as f64 * psf.pixel;
    let radii: Vec<f64> = (0..=RADII).map(|i| most * i as f64 / RADII as f64).collect();
    let energy = psf.encircled_energy(&radii);
    let kept = side.min(psf.side);
    let first = psf.side / 2 - kept / 2;
    let middle = |v: Vec<f64>| v[first..first + kept].to_vec();
    let line = [true, false].map(|tangential| middle(psf.line_spread(tangential)));
    let edge = [true, false].map(|tangential| middle(psf.edge_spread(tangential)));
    let places = (first..first + kept).map(|i| psf.place(i)).collect();
    // All files have as many pixels: what an image lacks around its middle is dark.
    let raster = psf.cropped(kept);
    let mut values = vec![0.0; side * side];
    let margin = side / 2 - kept / 2;
    for (row, part) in raster.values.chunks_exact(kept).enumerate() {
        let start = (row + (side - kept - margin)) * side + margin;
        values[start..start + kept].copy_from_slice(part);
    }
    psf.values = vec![];
    Image { psf, radii, energy, line, edge, places, raster: values }
}

fn plotted(image: &Image) -> PointImageCurves {
    let psf = &image.psf;
    let plane = if psf.defocus == 0.0 { String::new() } else { format!(" {:+.3} mm", psf.defocus) };
    let curve = |values: &[f64], scale: f64| {
        image.places.iter().zip(values).map(|(x, v)| DVec2::new(1e3 * x, v * scale)).collect::<Vec<_>>()
    };
    let largest = image.line.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
    PointImageCurves {
        name: format!("{:.1}° {:.0} nm{plane}", psf.field_deg, psf.nm),
        energy: image.radii.iter().zip(&image.energy).map(|(r, e)| DVec2::new(1e3 * r, *e)).collect(),
        line: [0, 1].map(|i| curve(&image.line[i], 1.0 / largest)),
        edge: [0, 1].map(|i| curve(&image.edge[i], 1.0)),
    }
}

fn finished(text: &str, value: &Value, json: bool) -> anyhow::Result<()> {
    if json {
        return print_json(value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

pub(super) fn wavefront(asked: &Asked, order: ZernikeOrder, terms: usize, rays: usize, json: bool) -> anyhow::Result<()> {
    let numbering = match order {
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
    let bench = table.bench();
    let fields = table.fields.iter().flat_map(|f| table.wavelengths.iter().map(|nm| (*f, *nm)));
    let found: Vec<(Wavefront, Option<Fit>)> = fields
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
    let heads: String = found.iter().map(|(w, _)| format!(" {:>16}", format!("{:.2}° {:.0} nm", w.field_deg, w.nm))).collect();
    writeln!(t, "  {name:>6} {:>3} {:>3}{heads}", "n", "m")?;
    for (i, term) in (1..=terms).filter_map(|number| numbering.term(number)).enumerate() {
        let cells: String =
            found.iter().map(|(_, fit)| format!(" {:>16}", cell(fit.as_ref().map(|f| f.coefficients[i])))).collect();
        writeln!(t, "  {:>6} {:>3} {:>3}{cells}  {}", term.number, term.n, term.m, term.name())?;
    }
    let planes: Vec<Plane> = found.iter().map(|(w, _)| (channel("opd", w.field_deg, w.nm, 0.0), w.map())).collect();
    let plot = || {
        let label = |w: &Wavefront| format!("{:.1}° {:.0} nm", w.field_deg, w.nm);
        let curves: Vec<(String, &Fit)> = found.iter().filter_map(|(w, fit)| Some((label(w), fit.as_ref()?))).collect();
        Fit::plot(&table.title(&format!("Zernike coefficients, {name}")), &curves)
    };
    files.write(rays, &planes, plot)?;
    finished(&t, &json!(values), json)
}
