//! `measure report`: a body and a lens on one page, as a laboratory would print it.
//!
//! Photographs the embedded charts, measures them as any picture is measured, and sets what the optical bench, the chain and the data sheet say beside it. The
//! page holds everything it shows: plots as drawings, tables as text.

use super::photograph::{Photograph, Setup, take};
use super::predictor::Predictor;
use super::resolution;
use super::{
    COLORS, Channel, Measured, beside_bench, color, color_figure, color_text, distortion, distortion_by_bench, distortion_figure,
    distortion_text, glare, illumination_by_bench, line, oecf, range_figure, range_text, ranges, rolling, sheet,
    strongest_channel, vignetting, vignetting_figure, vignetting_text,
};
use crate::UsageError;
use crate::args::MeasureReport;
use crate::commands::{body, print_json};
use crate::document::{self, Block, Document};
use crate::watch::say;
use anyhow::anyhow;
use diopter::image::{ExposureFacts, RawImage};
use diopter::lens::draw::{Axis, Chart, Figure, Style};
use diopter::measure::corners::Corners;
use diopter::measure::developed::{self, Development};
use diopter::measure::oecf::Response;
use diopter::measure::rolling::{Rolling, Sign};
use diopter::measure::{EdgeMtf, MeasureError, Plane, mtf};
use diopter::quantity::{FNumber, Iso, IsoChoice, LengthMm, Seconds, Size};
use diopter::scene::builtin::{charts, color_chart};
use diopter::sensor::Sensor;
use diopter::sensor::format::FULL_FRAME_DIAGONAL_MM;
use diopter::shot::{read_body, read_lens};
use serde_json::json;

/// Edges that are plotted: the one nearest to the middle, the farthest, and one between.
const PLOTTED: usize = 3;

/// Half of the width of the window of line spread functions, pixels: raw values are noisy, and our pictures have no halos.
const REACH_PX: f64 = 12.0;

/// Pixels and samples of the step wedge: means of fields need no more.
const WEDGE_SIZE: Size = Size { width: 480, height: 320 };
const WEDGE_SPP: u32 = 32;
/// Of the clear field, fraction of saturation.
const CLEAR: f64 = 0.9;
/// Attempts to find the time for it, and factor of the time where the field is clipped.
const ATTEMPTS: usize = 8;
const SHORTER: f64 = 0.1;

/// Columns and rows of the field that shows the rolling shutter, samples, mains (Hz) and how much its lamps flicker.
const BANDS_SIZE: Size = Size { width: 96, height: 240 };
const BANDS_SPP: u32 = 64;
const MAINS_HZ: f64 = 50.0;
const FLICKER: &str = "mains 50 Hz 0.8";
/// Shutter time of it, s: short against the period of the light.
const BANDS_S: f64 = 1.0 / 1000.0;

/// Of the picture's side that charts before a thin lens fill.
const FILLED: f64 = 0.95;

/// Pixels of the picture that shows veiling glare.
const GLARE_SIZE: Size = Size { width: 240, height: 160 };

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(asked: &MeasureReport, json: bool) -> anyhow::Result<()> {
    let output = document::prepare(&asked.output)?;
    if let Some(Seconds(time)) = asked.readout.filter(|t| !(t.0 > 0.0 && t.0 <= 1000.0)) {
        return Err(UsageError(anyhow!("--readout {time} s: expected a time above 0, up to 1000 s, such as 20ms")).into());
    }
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
    let mut tiles: Vec<[String; 3]> = vec![];
    let mut tile = |name: &str, value: String, remark: String| tiles.push([name.to_owned(), value, remark]);

    let edges = photograph(&setup, "slanted-edges")?;
    let (plane, channel) = strongest_plane(&edges.raw)?;
    let options = mtf::Options { reach: Some(REACH_PX), ..mtf::Options::default() };
    let mut found = edges_of(&plane, &options)?;
    let middle = [0.5 * plane.width as f64, 0.5 * plane.height as f64];
    let height = |e: &EdgeMtf| (e.middle[0] - middle[0]).hypot(e.middle[1] - middle[1]);
    found.sort_by(|a, b| height(a).total_cmp(&height(b)));
    let f = &edges.facts;
    page.title = format!("{}, {}", f.body, f.lens);
    let focus = f.focus_distance_m.map_or("infinity".to_owned(), |d| format!("{d:.3} m"));
    page.paragraph(&format!(
        "{:.1} mm ({:.1} mm on 36 × 24 mm), f/{:.2} (T/{:.2}), focused at {focus}, ISO {:.0}; photographs of {} × {} pixels, {} samples a pixel. \
         Charts under D65; raw values of the {} channel unless said otherwise. Broken lines: what the model says.",
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
    let at_a_glance = page.blocks.len();

    // Resolution, beside the chain.
    let predictor = edges.predictor()?;
    let predicted = predictor.raw(channel, &found)?;
    let (predictions, pitch_mm) = (&predicted.chains, predicted.pitch_mm);
    let last = found.len() - 1;
    let mut picks: Vec<usize> = (0..PLOTTED).map(|k| k * last / (PLOTTED - 1)).collect();
    picks.dedup();
    let shown: Vec<EdgeMtf> = picks.iter().map(|k| found[*k].clone()).collect();
    let all_lines = predicted.lines();
    let lines: Vec<&[f64]> = picks.iter().map(|k| all_lines[*k]).collect();
    let per_mm = Some(1.0 / pitch_mm);
    let text = resolution::text("slanted-edges", &found, channel, per_mm, plane.picture_height())?
        + &resolution::chain_text(&found, predictions)?;
    let heights = mtf50_figure(&found, &all_lines, predictions.iter().map(|p| p.height_mm).collect(), pitch_mm);
    let figures = [resolution::figure("slanted-edges", channel, per_mm, &shown, &lines), heights];
    page.section("Resolution", &figures, &text);
    let mtf50 = |e: &EdgeMtf| e.mtf50.map_or("-".to_owned(), |v| format!("{:.0} LW/PH", 2.0 * v * plane.picture_height() as f64));
    tile("MTF50, middle", mtf50(&found[0]), format!("{:.1} mm from the middle", height(&found[0]) * pitch_mm));
    tile("MTF50, outside", mtf50(&found[last]), format!("{:.1} mm from the middle", height(&found[last]) * pitch_mm));

    // The same developed.
    let developed = developed_resolution(&edges, &predictor, &mut page)?;

    // Distortion, beside the bench.
    let dots = photograph(&setup, "dot-grid")?;
    let dots_plane = strongest_plane(&dots.raw)?.0;
    let bent = distortion::measure(&dots_plane)?;
    let mut bench = dots.bench(distortion_by_bench);
    bench.retain(|(h, _)| *h <= bent.largest_height);
    let text = distortion_text("dot-grid", channel, &bent)? + &beside_bench(&bench, " %", 3, |h| bent.percent(h))?;
    page.section(
        "Distortion",
        &[distortion_figure("dot-grid", &bent, &bench), displaced_figure(&bent, [dots_plane.width, dots_plane.height])],
        &text,
    );
    tile("Distortion", format!("{:+.2} %", bent.percent(bent.largest_height)), format!("TV {:+.2} %", bent.tv_percent));

    // Vignetting.
    let field = photograph(&setup, "flat-field")?;
    let light = vignetting::measure(&strongest_plane(&field.raw)?.0)?;
    let bench = field.bench(illumination_by_bench);
    let text = vignetting_text("flat-field", channel, &light)? + &beside_bench(&bench, "", 4, |h| light.at(h))?;
    page.section("Relative illumination", &[vignetting_figure("flat-field", &light, &bench)], &text);
    tile("Corners", format!("{:+.2} EV", -light.corner_ev()), "against the middle".into());

    // Veiling glare of the lens.
    let veil = veiling_glare(&setup, &mut page)?;
    if let Some((index, _)) = &veil {
        tile("Veiling glare", format!("{:.2} %", 100.0 * index), "ISO 9358, bright on all sides".into());
    }

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
        tile("Dynamic range", format!("{:.1} stops", first.measured.dynamic_range.log2()), format!("EMVA 1288, ISO {iso:.0}"));
    }

    // Charts before a thin lens fill the picture on every format.
    let filling = |framing_mm: f64| Some(LengthMm(FILLED * framing_mm * (edges.film_mm[0] / 36.0).min(edges.film_mm[1] / 24.0)));

    // Tone response and dynamic range from a picture.
    let framed = Setup { focal_length: filling(charts::FRAMING.focal_length_mm), ..setup };
    let tones = tone_response(&framed, &sensor, rows.first().map(|r| r.1.measured.dynamic_range.log2()), &mut page)?;

    // Shutter.
    let shutter = rolling_shutter(&setup, asked.readout, &mut page)?;
    if let Some(found) = &shutter {
        tile("Rolling shutter", format!("{:.1} ms", 1e3 * found.readout_s), "read-out of the picture".into());
    }

    // Colour: the body and its development, before a thin lens, which has no colour of its own.
    let colors = if sensor.cfa.is_monochrome() {
        page.paragraph("Colour: the sensor is monochrome.");
        None
    } else {
        let focal_length = filling(color_chart::FRAMING.focal_length_mm);
        let chart = photograph(&Setup { lens: "thin", aperture: None, focal_length, ..setup }, "color-chart")?;
        let picture = developed::measured(&chart.picture);
        let corners = chart_corners(&chart.facts, [chart.picture.pixels.width, chart.picture.pixels.height], COLOR_CHART);
        match color::measure(&picture, Some(corners), "D65") {
            Ok(found) => {
                let text = color_text("color-chart, default development", &found)?;
                page.section("Colour", &[color_figure("color-chart", &found)], &text);
                tile("Colour", format!("dE00 {:.1}", found.mean), format!("largest {:.1}; default development", found.largest));
                Some(found)
            }
            // A film of another shape may not show all of the chart.
            Err(e) => {
                page.paragraph(&format!("Colour: {e}"));
                None
            }
        }
    };

    page.blocks.insert(at_a_glance, Block::Tiles(tiles));
    let path = page.write(output)?;
    say(&format!("wrote {}", path.display()));
    if json {
        return print_json(&json!({
            "file": path, "facts": edges.facts, "edges": found, "predicted": predictions, "developed": developed, "distortion": bent,
            "vignetting": light, "glare": veil.map(|(index, value)| json!({ "index": index, "lens": value })),
            "dynamic_range": rows.iter().map(|(iso, r)| json!({ "iso": iso, "emva": r })).collect::<Vec<_>>(), "oecf": tones,
            "rolling": shutter, "color": colors,
        }));
    }
    Ok(())
}

/// Frequencies of half response over image height, measured and predicted.
fn mtf50_figure(edges: &[EdgeMtf], predicted: &[&[f64]], heights_mm: Vec<f64>, pitch_mm: f64) -> Figure {
    let half = |e: &EdgeMtf, response: &[f64]| {
        let k = response.windows(2).position(|w| w[0] >= 0.5 && w[1] < 0.5)?;
        let [a, b] = [response[k], response[k + 1]];
        Some((e.frequencies[k] + (e.frequencies[k + 1] - e.frequencies[k]) * (a - 0.5) / (a - b)) / pitch_mm)
    };
    let pairs = || edges.iter().zip(predicted).zip(&heights_mm);
    // Edges that run along the radius are blurred along the tangent: sagittal and tangential differ.
    let points = |radial: bool, of_model: bool| {
        pairs()
            .filter(move |((e, _), h)| is_radial(e, edges) == radial || **h == 0.0)
            .filter_map(move |((e, p), h)| Some((*h, if of_model { half(e, p)? } else { half(e, &e.mtf)? })))
            .collect::<Vec<_>>()
    };
    let lines = [points(true, false), points(false, false), points(true, true), points(false, true)];
    let [most_mm, most] = lines.iter().flatten().fold([1e-3f64; 2], |[x, y], p| [x.max(p.0), y.max(p.1)]);
    let [across, along, predicted_across, predicted_along] = lines;
    // A cross for each edge.
    let crosses = |name: &str, color: usize, at: &[(f64, f64)]| {
        let [dx, dy] = [0.008 * most_mm, 0.01 * most];
        let arms = at.iter().flat_map(|(x, y)| [[(x - dx, *y), (x + dx, *y)], [(*x, y - dy), (*x, y + dy)]]);
        let named = arms.enumerate().map(|(k, arm)| line(if k == 0 { name } else { "" }, color, Style::Full, arm));
        named.collect::<Vec<_>>()
    };
    let mut all = crosses("across the radius", 0, &across);
    all.extend(crosses("along the radius", 1, &along));
    all.push(line("predicted", 0, Style::Broken, predicted_across));
    all.push(line("", 1, Style::Broken, predicted_along));
    sheet(&Chart {
        title: "MTF50 over the picture".into(),
        x: Axis { label: "image height, mm".into(), range: [0.0, 1.1 * most_mm] },
        y: Axis { label: "MTF50, cycles/mm".into(), range: [0.0, 1.3 * most] },
        lines: all,
    })
}

/// Whether an edge is crossed along the radius (tangential response).
fn is_radial(edge: &EdgeMtf, edges: &[EdgeMtf]) -> bool {
    // The middle of all edges stands in for that of the picture, about which they lie.
    let n = edges.len() as f64;
    let mean = [0, 1].map(|k| edges.iter().map(|e| e.middle[k]).sum::<f64>() / n);
    let radius = [edge.middle[0] - mean[0], edge.middle[1] - mean[1]];
    let along = radius[0] * edge.across[0] + radius[1] * edge.across[1];
    along.abs() > std::f64::consts::FRAC_1_SQRT_2 * radius[0].hypot(radius[1])
}

/// The edges of the chart, which needs pixels and samples enough to show them.
fn edges_of(plane: &Plane, options: &mtf::Options) -> anyhow::Result<Vec<EdgeMtf>> {
    mtf::find(plane, options).map_err(|e| match e {
        MeasureError::Unfit { place, found, .. } => {
            let size = format!("{} x {}", plane.width, plane.height);
            let (found, expected) =
                (format!("{found} in {size} pixels"), "a larger --size (480x320 and more), or more --spp".into());
            MeasureError::Unfit { place, found, expected }.into()
        }
        other => other.into(),
    })
}

/// Edges of the developed picture beside the chain with the development, for a few of them.
fn developed_resolution(
    edges: &Photograph,
    predictor: &Predictor,
    page: &mut Document,
) -> anyhow::Result<Option<Vec<developed::Developed>>> {
    if edges.raw.header.cfa.is_monochrome() {
        return Ok(None);
    }
    let picture = developed::measured(&edges.picture);
    let plane = picture.plane(Channel::Luminance)?;
    let options = mtf::Options { reach: Some(REACH_PX), ..mtf::Options::default() };
    let mut found = edges_of(&plane, &options)?;
    let middle = [0.5 * plane.width as f64, 0.5 * plane.height as f64];
    found.sort_by(|a, b| {
        let height = |e: &EdgeMtf| (e.middle[0] - middle[0]).hypot(e.middle[1] - middle[1]);
        height(a).total_cmp(&height(b))
    });
    let last = found.len() - 1;
    let mut picks: Vec<usize> = (0..PLOTTED).map(|k| k * last / (PLOTTED - 1)).collect();
    picks.dedup();
    let shown: Vec<EdgeMtf> = picks.iter().map(|k| found[*k].clone()).collect();
    let size = [plane.width, plane.height];
    let development = Development { raw: &edges.raw, recipe: &edges.shot.recipe, lut: edges.shot.lut.as_ref(), size };
    let predicted = predictor.developed(&development, Channel::Luminance, &shown, &options)?;
    let per_mm = Some(1.0 / predicted.pitch_mm);
    let lines = predicted.lines();
    let figure = resolution::figure("slanted-edges, developed", Channel::Luminance, per_mm, &shown, &lines);
    let steps = steps_figure(&predicted.developed[0]);
    let text = resolution::text("slanted-edges, default development", &shown, Channel::Luminance, per_mm, plane.height)?
        + &resolution::developed_text(&shown, &predicted.developed)?;
    page.section("Resolution of the developed picture", &[figure, steps], &text);
    Ok(Some(predicted.developed))
}

/// What each step of the development does to the response.
fn steps_figure(d: &developed::Developed) -> Figure {
    let points = |values: &[f64]| {
        let pairs = d.frequencies.iter().copied().zip(values.iter().copied());
        pairs.filter(|(f, _)| *f <= 0.5).collect::<Vec<_>>()
    };
    let chain = line("raw chain", COLORS.len() - 1, Style::Full, points(&d.raw));
    let steps = d.steps.iter().enumerate().map(|(k, s)| line(s.name, k, Style::Full, points(&s.factor)));
    sheet(&Chart {
        title: "chain and development, middle of the picture".into(),
        x: Axis { label: "cycles/pixel".into(), range: [0.0, 0.5] },
        y: Axis { label: "factor of the response".into(), range: [0.0, 1.4] },
        lines: [chain].into_iter().chain(steps).collect(),
    })
}

/// Where dots lie, and where they would without distortion by the fit, displacements ten times as long.
fn displaced_figure(bent: &distortion::Distortion, [width, height]: [usize; 2]) -> Figure {
    const LONGER: f64 = 10.0;
    let middle = [0.5 * width as f64, 0.5 * height as f64];
    let half = middle[0].hypot(middle[1]);
    let lines = bent.dots.iter().flat_map(|d| {
        let seen = [0, 1].map(|k| (d.place[k] - middle[k]) / half);
        let ratio = 1.0 + bent.percent(seen[0].hypot(seen[1])) / 100.0;
        let ideal = seen.map(|v| v / ratio);
        let end = [0, 1].map(|k| ideal[k] + LONGER * (seen[k] - ideal[k]));
        // Down the picture is down on the page.
        [line("", 5, Style::Full, [(ideal[0], -ideal[1]), (end[0], -end[1])]), line("", 0, Style::Dots, [(end[0], -end[1])])]
    });
    sheet(&Chart {
        title: "displacement of the dots, ten times".into(),
        x: Axis { label: "half diagonals".into(), range: [-1.0, 1.0] },
        y: Axis { label: "half diagonals".into(), range: [-0.7, 0.7] },
        lines: lines.collect(),
    })
}

/// The veiling glare of the lens, and of a photograph with it; nothing of lenses whose glare cannot be traced.
fn veiling_glare(setup: &Setup, page: &mut Document) -> anyhow::Result<Option<(f64, serde_json::Value)>> {
    let mut file = setup.shot_file("glare-spot");
    file.render.size = Some(GLARE_SIZE);
    file.render.stray = Some("all".into());
    let spot = match take(&file, "glare-spot") {
        Ok(spot) => spot,
        Err(e) => {
            page.heading("Veiling glare");
            page.paragraph(&format!("Not measured: {e}"));
            return Ok(None);
        }
    };
    let [width, height] = spot.film_mm;
    let asked = glare::LensGlare {
        aperture: Some(spot.facts.f_number),
        focal_length: setup.focal_length.map(|l| l.0),
        film: [width, height],
        hood: None,
        rays: glare::REPORT_RAYS,
    };
    let (plane, channel) = strongest_plane(&spot.raw)?;
    let seen = diopter::measure::glare::measure(&plane, None);
    match glare::traced(&asked, setup.lens) {
        Ok(traced) => {
            let mut text = String::new();
            match &seen {
                Ok(seen) => text.push_str(&format!(
                    "glare-spot, {}: veiling glare index {:.3} % ± {:.3} % in the photograph (diffraction, reflections and scatter)\n",
                    channel.name(),
                    100.0 * seen.index,
                    100.0 * seen.error
                )),
                Err(e) => text.push_str(&format!("glare-spot: {e}\n")),
            }
            text.push_str(&traced.text()?);
            page.section("Veiling glare", &[traced.figure(), traced.kept_figure()], &text);
            let mut value = traced.value();
            value["photograph"] = json!(seen.ok());
            Ok(Some((traced.index(), value)))
        }
        Err(e) => {
            page.heading("Veiling glare");
            page.paragraph(&format!("Not traced: {e:#}"));
            Ok(None)
        }
    }
}

/// Tone response, noise and dynamic range of the body by a step wedge, before a thin lens; `emva`: stops by EMVA 1288.
fn tone_response(
    setup: &Setup,
    sensor: &Sensor,
    emva: Option<f64>,
    page: &mut Document,
) -> anyhow::Result<Option<Vec<Response>>> {
    let thin = Setup { lens: "thin", aperture: Some(FNumber(8.0)), size: Some(WEDGE_SIZE), spp: WEDGE_SPP, ..*setup };
    let lowest = sensor.iso_range()[0];
    let mut file = thin.shot_file("step-wedge");
    file.exposure.iso = Some(IsoChoice::Fixed(Iso(lowest)));
    let mut time_s = 0.01;
    let mut wedge = None;
    // The clear field just below white.
    for _ in 0..ATTEMPTS {
        file.exposure.shutter = Some(Seconds(time_s));
        let photo = take(&file, "step-wedge")?;
        let Ok(found) = responses(&photo, None) else {
            wedge = Some(photo);
            break;
        };
        let clear = found.iter().filter_map(|r| Some((r, r.fields.first()?))).max_by(|a, b| a.1.signal.total_cmp(&b.1.signal));
        let Some((_, clear)) = clear else { break };
        let (signal, saturated) = (clear.signal, clear.saturated);
        let done = !saturated && (signal / CLEAR - 1.0).abs() < 0.1;
        wedge = Some(photo);
        if done {
            break;
        }
        time_s *= if saturated { SHORTER } else { (CLEAR / signal.max(1e-6)).min(1.0 / SHORTER) };
    }
    let Some(wedge) = wedge else { return Ok(None) };
    let flat = {
        let mut file = file.clone();
        file.scene.file = Some("flat-field".into());
        // Another light than the wedge's: its fall-off alone is looked at.
        (file.exposure.shutter, file.exposure.iso) = (None, None);
        Measured::Raw(Box::new(take(&file, "flat-field")?.raw))
    };
    match responses(&wedge, Some(&flat)) {
        Ok(found) => {
            let mut text = oecf::text("step-wedge", 2, &found)?;
            if let Some(stops) = emva {
                text.push_str(&format!("  EMVA 1288 of the same body at its lowest ISO speed: {stops:.2} stops\n"));
            }
            let snr = snr_figure(&found);
            page.section("Tone response (OECF) and dynamic range", &[oecf::figure("step-wedge", &found), snr], &text);
            Ok(Some(found))
        }
        Err(e) => {
            page.heading("Tone response (OECF) and dynamic range");
            page.paragraph(&format!("Not measured: {e}"));
            Ok(None)
        }
    }
}

/// OECF of each channel from two readings of one exposure.
fn responses(photo: &Photograph, flat: Option<&Measured>) -> Result<Vec<Response>, MeasureError> {
    let corners = chart_corners(&photo.facts, photo.raw.size(), wedge_mm());
    let pictures: Vec<Measured> =
        [Some(&photo.raw), photo.second.as_ref()].into_iter().flatten().map(|r| Measured::Raw(Box::new(r.clone()))).collect();
    let channels = match photo.raw.header.cfa.is_monochrome() {
        true => vec![Channel::Clear],
        false => vec![Channel::Red, Channel::Green, Channel::Blue],
    };
    let known = |c: &Channel| pictures[0].plane(*c).is_ok();
    channels
        .into_iter()
        .filter(known)
        .map(|c| diopter::measure::oecf::measure(&pictures, c, Some(corners), charts::WEDGE_GRID, None, flat))
        .collect()
}

/// Signal over noise against light.
fn snr_figure(found: &[Response]) -> Figure {
    let db = |snr: f64| 20.0 * snr.max(1e-2).log10();
    let lines = found.iter().map(|r| {
        let k = ["red", "blue", "green"].iter().position(|c| *c == r.channel).unwrap_or(COLORS.len() - 1);
        let points = r.fields.iter().filter(|f| !f.saturated).map(|f| (-f.density, db(f.snr).max(-10.0)));
        line(r.channel, k, Style::Full, points)
    });
    let lines: Vec<_> = lines.collect();
    let all: Vec<(f64, f64)> = lines.iter().flat_map(|l| l.points.iter().map(|p| (p.x, p.y))).collect();
    sheet(&Chart {
        title: "signal to noise (ISO 15739), temporal".into(),
        x: Axis::around("log light relative to the clear field", all.iter().map(|p| p.0), false),
        y: Axis::around("SNR, dB", all.iter().map(|p| p.1), true),
        lines,
    })
}

/// Read-out of an electronic shutter, by the bands that lamps on the mains draw.
fn rolling_shutter(setup: &Setup, readout: Option<Seconds>, page: &mut Document) -> anyhow::Result<Option<Rolling>> {
    let thin = Setup { lens: "thin", aperture: None, focal_length: None, size: Some(BANDS_SIZE), spp: BANDS_SPP, ..*setup };
    let mut file = thin.shot_file("flat-field");
    file.scene.flicker = vec![FLICKER.parse().map_err(|e: String| anyhow!(e))?];
    file.exposure.shutter = Some(Seconds(BANDS_S));
    file.shutter.kind = Some("rolling".into());
    file.shutter.readout = readout;
    let photo = take(&file, "flat-field")?;
    let (plane, channel) = strongest_plane(&photo.raw)?;
    match diopter::measure::rolling::measure(&plane, Sign::Flicker(2.0 * MAINS_HZ)) {
        Ok(found) => {
            let told = photo.facts.shutter.as_ref().map(|s| rolling::told_readout(s, &found));
            let mut text = rolling::text("flat-field under lamps on 50 Hz", channel, &found, told)?;
            if readout.is_none() {
                text.push_str("  data sheets of bodies do not say it: that of the default (--readout sets another)\n");
            }
            page.section("Rolling shutter", &[rolling::figure("flat-field", &found)], &text);
            Ok(Some(found))
        }
        Err(e) => {
            page.heading("Rolling shutter");
            page.paragraph(&format!("Not measured: {e}"));
            Ok(None)
        }
    }
}

/// Takes a photograph of an embedded chart.
fn photograph(setup: &Setup, chart: &str) -> anyhow::Result<Photograph> {
    take(&setup.shot_file(chart), chart)
}

/// Half width and half height of the patches of "color-chart", mm.
const COLOR_CHART: [f64; 2] = [130.0, 86.0];

/// The same of the fields of "step-wedge".
fn wedge_mm() -> [f64; 2] {
    let seen = |n: usize| (f64::from(charts::WEDGE_STEP) * (n as f64 - 1.0) + f64::from(charts::WEDGE_FIELD)) * 500.0;
    charts::WEDGE_GRID.map(seen)
}

/// Outer corners of a chart of a half width and height (mm) in its photograph with a thin lens, pixels. All charts are framed alike.
fn chart_corners(facts: &ExposureFacts, size: [usize; 2], half_mm: [f64; 2]) -> Corners {
    let [columns, rows] = size.map(|s| s as f64);
    let focal_mm = facts.focal_length_mm;
    let pitch_mm = FULL_FRAME_DIAGONAL_MM * focal_mm / facts.focal_length_35mm_mm / columns.hypot(rows);
    let focus_m = if half_mm == COLOR_CHART { color_chart::FRAMING.focus_m } else { charts::FRAMING.focus_m };
    let magnification = focal_mm / (1000.0 * focus_m - focal_mm);
    let [x, y] = half_mm.map(|half_mm| half_mm * magnification / pitch_mm);
    [[-x, -y], [x, -y], [x, y], [-x, y]].map(|[a, b]| [0.5 * columns + a, 0.5 * rows + b])
}

/// Raw values of the channel that there are most pixels of.
fn strongest_plane(raw: &RawImage) -> anyhow::Result<(Plane, Channel)> {
    let measured = Measured::Raw(Box::new(raw.clone()));
    let channel = measured.usual_channel();
    Ok((measured.plane(channel)?, channel))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chart_lies_where_its_own_framing_puts_it() {
        // 100 mm on 36 × 24 mm is the framing itself.
        let facts = ExposureFacts { focal_length_mm: 100.0, focal_length_35mm_mm: 100.0, ..Default::default() };
        let [found, framed] = [chart_corners(&facts, [960, 640], COLOR_CHART), color::framed([960, 640]).unwrap()];
        for (a, b) in found.iter().zip(&framed) {
            assert!((a[0] - b[0]).abs() < 0.5 && (a[1] - b[1]).abs() < 0.5, "{found:?} {framed:?}");
        }
    }
}
