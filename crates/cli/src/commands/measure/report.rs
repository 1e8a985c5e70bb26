//! `measure report`: a body and a lens on one page, as a laboratory would print it.
//!
//! Photographs the embedded charts, measures them as any picture is measured, and sets what the optical bench and the data sheet say beside it. The
//! page holds everything it shows: plots as drawings, tables as text.

use super::{
    Channel, Charted, Measured, beside_bench, chain_text, color, color_figure, color_text, distortion, distortion_by_bench,
    distortion_figure, distortion_text, illumination_by_bench, mtf, predicted, range_figure, range_text, ranges,
    resolution_figure, resolution_text, strongest_channel, vignetting, vignetting_figure, vignetting_text,
};
use crate::args::MeasureReport;
use crate::commands::{body, print_json};
use crate::document::{self, Document};
use crate::watch::{say, warn, watched};
use diopter::image::{ExposureFacts, Picture, RawImage};
use diopter::lens::CompoundLens;
use diopter::measure::{EdgeMtf, Plane};
use diopter::quantity::{FNumber, LengthMm, Size};
use diopter::scene::builtin::color_chart;
use diopter::sensor::format::FULL_FRAME_DIAGONAL_MM;
use diopter::shot::{Shot, ShotFile, read_body, read_lens};
use serde_json::json;
use std::path::Path;

/// Edges that are plotted: the one nearest to the middle, the farthest, and one between.
const PLOTTED: usize = 3;

/// Half of the width of the window of line spread functions, pixels: raw values are noisy, and our pictures have no halos.
const REACH_PX: f64 = 12.0;

/// With what charts are photographed.
pub(super) struct Setup<'a> {
    pub(super) body: &'a str,
    pub(super) lens: &'a str,
    pub(super) aperture: Option<FNumber>,
    pub(super) focal_length: Option<LengthMm>,
    pub(super) size: Option<Size>,
    pub(super) spp: u32,
}

/// A photograph of a chart.
pub(super) struct Photograph {
    pub(super) raw: RawImage,
    picture: Picture,
    facts: ExposureFacts,
    /// What it was taken through; none of ideal lenses.
    lens: Option<Box<CompoundLens>>,
    film_mm: [f64; 2],
}

impl Photograph {
    /// What the optical bench says of the lens at image heights over half of the diagonal; nothing of ideal lenses.
    fn bench(&self, says: impl Fn(&CompoundLens, [f64; 2]) -> Vec<(f64, f64)>) -> Vec<(f64, f64)> {
        self.lens.as_deref().map_or(vec![], |lens| says(lens, self.film_mm))
    }
}

pub fn run(asked: &MeasureReport, json: bool) -> anyhow::Result<()> {
    let output = document::prepare(&asked.output)?;
    let sensor = read_body(&asked.body)?;
    // Before anything is photographed: the chain is predicted for lenses with surfaces.
    read_lens(&asked.lens)?;
    let mut page = Document::default();
    let setup = Setup {
        body: &asked.body,
        lens: &asked.lens,
        aperture: asked.aperture,
        focal_length: asked.focal_length,
        size: asked.size,
        spp: asked.spp,
    };

    let edges = photograph(&setup, "slanted-edges")?;
    let (plane, channel) = strongest_plane(&edges.raw)?;
    let mut found = mtf::find(&plane, &mtf::Options { reach: Some(REACH_PX), ..mtf::Options::default() })?;
    let middle = [0.5 * plane.width as f64, 0.5 * plane.height as f64];
    let height = |e: &EdgeMtf| (e.middle[0] - middle[0]).hypot(e.middle[1] - middle[1]);
    found.sort_by(|a, b| height(a).total_cmp(&height(b)));
    let f = &edges.facts;
    page.title = format!("{}, {}", f.body, f.lens);
    let focus = f.focus_distance_m.map_or("infinity".to_owned(), |d| format!("{d:.3} m"));
    page.paragraph(&format!(
        "{:.1} mm ({:.1} mm on 36 × 24 mm), f/{:.2} (T/{:.2}), focused at {focus}, ISO {:.0}; photographs of {} × {} pixels, {} samples a pixel. \
         Charts under D65; raw values of the {} channel.",
        f.focal_length_mm,
        f.focal_length_35mm_mm,
        f.f_number,
        f.t_number,
        f.iso,
        plane.width,
        plane.height,
        asked.spp,
        channel.name()
    ));

    // Resolution, beside the chain.
    let size = [plane.width, plane.height];
    let chart = Charted { light: "D65", motion_px: [0.0; 2] };
    let (predictions, pitch_mm) =
        predicted(Path::new("slanted-edges"), chart, [&asked.lens, &asked.body], Some(f), channel, size, &found)?;
    let last = found.len() - 1;
    let mut picks: Vec<usize> = (0..PLOTTED).map(|k| k * last / (PLOTTED - 1)).collect();
    picks.dedup();
    let shown: Vec<EdgeMtf> = picks.iter().map(|k| found[*k].clone()).collect();
    let chains: Vec<_> = picks.iter().map(|k| predictions[*k].clone()).collect();
    let per_mm = Some(1.0 / pitch_mm);
    let text = resolution_text("slanted-edges", &found, channel, per_mm, plane.height)? + &chain_text(&found, &predictions)?;
    page.section("Resolution", &[resolution_figure("slanted-edges", channel, per_mm, &shown, &chains)], &text);

    // Distortion, beside the bench.
    let dots = photograph(&setup, "dot-grid")?;
    let bent = distortion::measure(&strongest_plane(&dots.raw)?.0)?;
    let mut bench = dots.bench(distortion_by_bench);
    bench.retain(|(h, _)| *h <= bent.largest_height);
    let text = distortion_text("dot-grid", channel, &bent)? + &beside_bench(&bench, " %", 3, |h| bent.percent(h))?;
    page.section("Distortion", &[distortion_figure("dot-grid", &bent, &bench)], &text);

    // Vignetting.
    let field = photograph(&setup, "flat-field")?;
    let light = vignetting::measure(&strongest_plane(&field.raw)?.0)?;
    let bench = field.bench(illumination_by_bench);
    let text = vignetting_text("flat-field", channel, &light)? + &beside_bench(&bench, "", 4, |h| light.at(h))?;
    page.section("Relative illumination", &[vignetting_figure("flat-field", &light, &bench)], &text);

    // The body alone.
    let settings: Vec<f64> = sensor.iso.iter().map(|i| i.iso).collect();
    let rows = ranges(&sensor, &settings)?;
    if let Some((iso, first)) = rows.first() {
        let name = sensor.cfa.channel_names()[strongest_channel(&sensor)];
        let title = format!("{}, ISO {iso:.0}, {name} at {:.0} nm", sensor.name, first.nm);
        page.section(
            "Noise and dynamic range",
            &[body::plot(&title, first), range_figure(&sensor, &rows)],
            &range_text(&sensor, &rows)?,
        );
    }

    // Colour: the body and its development, before a thin lens, which has no colour of its own.
    let colors = if sensor.cfa.is_monochrome() {
        page.paragraph("Colour: the sensor is monochrome.");
        None
    } else {
        let chart = photograph(&Setup { lens: "thin", aperture: None, focal_length: None, ..setup }, "color-chart")?;
        let pixels = linear(&chart.picture);
        let corners = chart_corners(&chart.facts, [pixels.width, pixels.height]);
        let bands = ["R", "G", "B"].map(str::to_owned).to_vec();
        let limits = [f32::NEG_INFINITY, f32::INFINITY];
        match color::measure(&Measured::Light { pixels, bands, limits, facts: None }, Some(corners), "D65") {
            Ok(found) => {
                let text = color_text("color-chart, default development", &found)?;
                page.section("Colour", &[color_figure("color-chart", &found)], &text);
                Some(found)
            }
            // A film of another shape may not show all of the chart.
            Err(e) => {
                page.paragraph(&format!("Colour: {e}"));
                None
            }
        }
    };

    let path = page.write(output)?;
    say(&format!("wrote {}", path.display()));
    if json {
        return print_json(&json!({
            "file": path, "facts": edges.facts, "edges": found, "predicted": predictions, "distortion": bent, "vignetting": light,
            "dynamic_range": rows.iter().map(|(iso, r)| json!({ "iso": iso, "emva": r })).collect::<Vec<_>>(), "color": colors,
        }));
    }
    Ok(())
}

impl Setup<'_> {
    /// The shot of a chart: an embedded scene, or a scene's file.
    pub(super) fn shot_file(&self, chart: &str) -> ShotFile {
        let mut file = ShotFile::default();
        file.scene.file = Some(chart.into());
        file.camera.body = Some(self.body.into());
        file.camera.lens = Some(self.lens.into());
        file.camera.focal_length = self.focal_length;
        file.exposure.aperture = self.aperture;
        file.render.size = self.size;
        file.render.spp = Some(self.spp);
        file
    }
}

/// Takes a photograph of an embedded chart.
fn photograph(setup: &Setup, chart: &str) -> anyhow::Result<Photograph> {
    take(&setup.shot_file(chart), chart)
}

/// Takes a photograph of a chart as a shot file says.
pub(super) fn take(file: &ShotFile, chart: &str) -> anyhow::Result<Photograph> {
    let mut shot = Shot::prepare(file, &mut warn)?;
    watched("focusing", |w| shot.focus(w, &mut warn))?;
    watched("metering", |w| shot.meter(w, &mut warn))?;
    say(&format!("photographing {chart}"));
    let plane = watched("exposing", |w| shot.expose(w))?;
    let raw = shot.read_out(&plane)?;
    let picture = shot.develop(&raw)?;
    let film_mm = [shot.camera.film.width_mm, shot.camera.film.height_mm];
    let lens = match shot.camera.lens {
        diopter::lens::Lens::Compound(lens) => Some(lens),
        _ => None,
    };
    Ok(Photograph { facts: raw.header.facts.clone(), raw, picture, lens, film_mm })
}

/// Outer corners of the patches of "color-chart" in its photograph with a thin lens, pixels: 0.26 × 0.172 m at the framing's distance.
fn chart_corners(facts: &ExposureFacts, size: [usize; 2]) -> diopter::measure::corners::Corners {
    let [columns, rows] = size.map(|s| s as f64);
    let focal_mm = facts.focal_length_mm;
    let pitch_mm = FULL_FRAME_DIAGONAL_MM * focal_mm / facts.focal_length_35mm_mm / columns.hypot(rows);
    let magnification = focal_mm / (1000.0 * color_chart::FRAMING.focus_m - focal_mm);
    let [x, y] = [130.0, 86.0].map(|half_mm| half_mm * magnification / pitch_mm);
    [[-x, -y], [x, -y], [x, y], [-x, y]].map(|[a, b]| [0.5 * columns + a, 0.5 * rows + b])
}

/// Raw values of the channel that there are most pixels of.
fn strongest_plane(raw: &RawImage) -> anyhow::Result<(Plane, Channel)> {
    let measured = Measured::Raw(Box::new(raw.clone()));
    let channel = measured.usual_channel();
    Ok((measured.plane(channel)?, channel))
}

/// Linear values of a picture.
fn linear(picture: &Picture) -> diopter::image::Raster<f32> {
    let luminance = picture.space.xyz_from_rgb().row(1).to_array().map(|v| v as f32);
    let mut pixels = picture.pixels.clone();
    pixels.data.as_chunks_mut::<3>().0.iter_mut().for_each(|p| *p = picture.encoding.decode_pixel(*p, luminance));
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chart_lies_where_its_own_framing_puts_it() {
        // 100 mm on 36 × 24 mm is the framing itself.
        let facts = ExposureFacts { focal_length_mm: 100.0, focal_length_35mm_mm: 100.0, ..Default::default() };
        let [found, framed] = [chart_corners(&facts, [960, 640]), color::framed([960, 640]).unwrap()];
        for (a, b) in found.iter().zip(&framed) {
            assert!((a[0] - b[0]).abs() < 0.5 && (a[1] - b[1]).abs() < 0.5, "{found:?} {framed:?}");
        }
    }
}
