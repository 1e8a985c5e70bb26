//! `lens psf`: the image of a point.

use super::GlobalFlags;
use super::bench::{Bench, Table, no_light, planes};
use super::image_files::{Files, Plane, channel, finished};
use crate::UsageError;
use crate::args::values::{List, list};
use anyhow::anyhow;
use diopter::lens::analysis::{self, PointImageCurves};
use glam::DVec2;
use serde_json::json;
use std::fmt::Write as _;

/// Largest images that are written, pixels across.
const MOST_PIXELS: usize = 2048;
/// Radii of the curve of encircled energy.
const RADII: usize = 96;

/// The image of a point: diffraction or geometric, Strehl ratio, encircled energy, line and edge spread; -o also writes .exr.
#[derive(clap::Args, Debug)]
pub struct Psf {
    #[command(flatten)]
    bench: Bench,
    /// Planes behind the film, mm: "-0.1,0,0.1".
    #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
    defocus: Option<List>,
    /// Size of a pixel, µm; half of what diffraction needs, without.
    #[arg(long, value_name = "UM")]
    pixel: Option<f64>,
    /// Pixels across the images that are written; as many as the light needs, without.
    #[arg(long, value_name = "N")]
    pixels: Option<usize>,
    /// From the rays alone, without diffraction.
    #[arg(long)]
    geometric: bool,
}

impl Psf {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let defocus = planes(self.defocus.as_ref())?;
        if let Some(bad) = self.pixel.filter(|p| !(*p >= 1e-3 && *p <= 1000.0)) {
            return Err(UsageError(anyhow!("pixel {bad} µm: expected 0.001 to 1000")).into());
        }
        if let Some(bad) = self.pixels.filter(|n| !(8..=MOST_PIXELS).contains(n)) {
            return Err(UsageError(anyhow!("pixels {bad}: expected 8 to {MOST_PIXELS} across")).into());
        }
        let table = Table::new(&self.bench)?;
        let files = Files::prepare(&self.bench)?;
        let bench = table.bench();
        let each: Vec<(f64, f64)> = table.fields.iter().flat_map(|f| table.wavelengths.iter().map(|nm| (*f, *nm))).collect();
        // One size of pixel for all images: the finest that one of them needs.
        let needed =
            each.iter().filter_map(|(f, nm)| bench.largest_psf_pixel(*f, *nm, table.reference)).fold(f64::INFINITY, f64::min);
        if !needed.is_finite() {
            return Err(no_light(table.fields[0]));
        }
        let pixel = match self.pixel.map(|um| 1e-3 * um) {
            Some(pixel) if !self.geometric && pixel > needed => {
                let most = 1e3 * needed;
                let what =
                    anyhow!("pixel {} µm: expected at most {most:.4} µm, half the period of the finest detail", 1e3 * pixel);
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
        let widest = defocus.iter().map(|d| spots(*d)).fold(0.0, f64::max);
        let side = self.pixels.unwrap_or_else(|| {
            let half = (3.0 * widest + 20.0 * needed) / pixel;
            (2 * (half.ceil() as usize + 4)).min(MOST_PIXELS)
        });
        if !self.geometric {
            table.warn_of_ideal_paths();
        }
        let mut images = vec![];
        for (field, nm) in &each {
            for plane in &defocus {
                let colors = [*nm, table.reference];
                let found = match self.geometric {
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
        files
            .write(side, &planes, || PointImageCurves::plot(&table.title(""), &images.iter().map(plotted).collect::<Vec<_>>()))?;
        finished(&t, &json!(values), global.json)
    }
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
    psf: analysis::Psf,
    radii: Vec<f64>,
    energy: Vec<f64>,
    line: [Vec<f64>; 2],
    edge: [Vec<f64>; 2],
    places: Vec<f64>,
    raster: Vec<f32>,
}

/// Measures an image and keeps the middle of it.
fn curves(mut psf: analysis::Psf, side: usize) -> Image {
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
