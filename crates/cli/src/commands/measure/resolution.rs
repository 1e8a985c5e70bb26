//! `measure mtf`: the response of slanted edges, raw or developed, beside what the chain makes of them.

use super::photograph::{Photograph, Setup, take};
use super::predictor::{Predicted, Predictor};
use super::{COLORS, as_taken, finish, line, name_of, region, sheet};
use crate::args::{LsfWindow, MeasureMtf, MeasuredChannel};
use crate::commands::{read_raw, why};
use crate::watch::{say, warn, watched};
use crate::{UsageError, paint};
use anyhow::anyhow;
use diopter::develop::lut::Lut;
use diopter::develop::{Developer, Recipe};
use diopter::image::{ExposureFacts, PictureSource, RawImage};
use diopter::lens::Lens;
use diopter::lens::draw::{Axis, Chart, Figure, Style};
use diopter::measure::developed::{self, Developed, Development};
use diopter::measure::motion::Motion;
use diopter::measure::mtf::{self, Options, Window};
use diopter::measure::predict::Prediction;
use diopter::measure::{Channel, EdgeMtf, Measured};
use diopter::recipe_file;
use diopter::scene::builtin;
use diopter::sensor::Sensor;
use diopter::shot::{Shot, ShotError, ShotFile, is_scene_file, read_body, read_lens};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Samples a pixel of a chart that is photographed, by default.
const CHART_SPP: u32 = 64;

/// What is measured, and all that is known of how it was taken.
struct Source {
    picture: Measured,
    /// The raw file that the picture was developed from.
    raw: Option<RawImage>,
    recipe: Recipe,
    lut: Option<Lut>,
    shot: Option<Box<Shot>>,
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(asked: &MeasureMtf, json: bool) -> anyhow::Result<()> {
    if let Some(pitch) = asked.pitch.filter(|p| !(*p > 0.0 && *p < 1e4)) {
        return Err(UsageError(anyhow!("--pitch {pitch}: expected the distance of pixels in µm, such as 5.36")).into());
    }
    let outputs = paint::prepare(&asked.output)?;
    let window = match asked.window {
        LsfWindow::Tukey => Window::Tukey { alpha: 0.5 },
        LsfWindow::Hann => Window::Tukey { alpha: 1.0 },
        LsfWindow::Hamming => Window::Hamming,
    };
    let options = Options { order: asked.order, window, reach: asked.reach };
    if let Some(lens) = &asked.lens {
        read_lens(lens)?;
    }
    if let Some(body) = &asked.body {
        read_body(body)?;
    }
    let source = source(asked)?;
    let picture = &source.picture;
    let channel = asked.channel.map_or_else(|| picture.usual_channel(), MeasuredChannel::measured);
    let plane = picture.plane(channel)?;
    let edges = match (asked.region, asked.at) {
        (Some(r), _) => vec![mtf::measure(&plane, region(r), &options)?],
        (_, Some(at)) => vec![mtf::measure_at(&plane, at, &options)?],
        _ => mtf::find(&plane, &options)?,
    };
    let size = [plane.width, plane.height];
    let predicted = match camera(asked, &source, channel, size)? {
        Some(camera) => Some(camera.predict(asked, &source, channel, size, &edges, &options)?),
        None => None,
    };
    let pitch_mm = predicted.as_ref().map(|p| p.pitch_mm).or(asked.pitch.map(|um| um / 1000.0));
    // Cycles a mm in a cycle a pixel.
    let per_mm = pitch_mm.map(|mm| 1.0 / mm);
    let value: Vec<Value> = edges
        .iter()
        .enumerate()
        .map(|(k, e)| {
            let mut value = json!(e);
            value["predicted"] = json!(predicted.as_ref().and_then(|p| p.chains.get(k)));
            value["developed"] = json!(predicted.as_ref().and_then(|p| p.developed.get(k)));
            if let Some(per_mm) = per_mm {
                let in_mm = |f: Option<f64>| f.map(|f| f * per_mm);
                value["mtf50_per_mm"] = json!(in_mm(e.mtf50));
                value["mtf10_per_mm"] = json!(in_mm(e.mtf10));
                value["frequencies_per_mm"] = json!(e.frequencies.iter().map(|f| f * per_mm).collect::<Vec<_>>());
            }
            value["mtf50_line_widths_per_picture_height"] = json!(e.mtf50.map(|f| 2.0 * f * plane.picture_height() as f64));
            value
        })
        .collect();
    let value =
        json!({ "file": asked.file, "channel": channel.name(), "pitch_um": pitch_mm.map(|mm| 1000.0 * mm), "edges": value });
    let mut told = text(&name_of(&asked.file), &edges, channel, per_mm, plane.picture_height())?;
    if let Some(p) = &predicted {
        told.push_str(&if p.developed.is_empty() {
            chain_text(&edges, &p.chains)?
        } else {
            developed_text(&edges, &p.developed)?
        });
    }
    let lines: Vec<&[f64]> = predicted.iter().flat_map(Predicted::lines).collect();
    finish(outputs, || figure(&name_of(&asked.file), channel, per_mm, &edges, &lines), &told, &value, json)
}

/// Reads or takes the picture.
fn source(asked: &MeasureMtf) -> anyhow::Result<Source> {
    let wrong = |what: String| anyhow::Error::from(UsageError(anyhow!(what)));
    let name = asked.file.display();
    if let Some(file) = shot_of_chart(asked)? {
        for (flag, given) in [("--raw", asked.raw.is_some()), ("--shot", asked.shot.is_some())] {
            if given {
                return Err(wrong(format!(
                    "{flag} with {name}: it is photographed now; expected a picture that was taken before"
                )));
            }
        }
        let Photograph { raw, picture, shot, .. } = take(&file, &name_of(&asked.file))?;
        let picture = if asked.developed { developed::measured(&picture) } else { Measured::Raw(Box::new(raw.clone())) };
        let (recipe, lut) = (shot.recipe.clone(), shot.lut.clone());
        return Ok(Source { picture, raw: asked.developed.then_some(raw), recipe, lut, shot: Some(Box::new(shot)) });
    }
    let is_raw = asked.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("dng"));
    let raw_path: Option<&Path> = match (&asked.raw, is_raw) {
        (Some(_), true) => return Err(wrong(format!("--raw with {name}: expected a picture that was developed from it"))),
        (Some(path), false) => Some(path),
        (None, true) => Some(&asked.file),
        (None, false) => None,
    };
    let raw = raw_path.map(read_raw).transpose()?;
    let shot = match (raw_path, &raw) {
        (Some(path), Some(raw)) => shot_of(asked, path, raw)?,
        _ if asked.shot.is_some() => {
            let what = "expected a raw file, or --raw with the one that the picture was developed from";
            return Err(wrong(format!("--shot with {name}: {what}")));
        }
        _ => None,
    };
    let mut recipe = shot.as_ref().map_or_else(Recipe::default, |s| s.recipe.clone());
    asked.developing.apply(&mut recipe)?;
    if raw.is_none() {
        if recipe != Recipe::default() {
            let what = "expected --raw with the raw file that it was developed from: its edges are developed again";
            return Err(wrong(format!("a recipe with {name}: {what}")));
        }
        if asked.developed {
            return Err(wrong(format!("--developed with {name}: it is; expected a raw file, a scene or a shot file")));
        }
        let picture = Measured::read(&asked.file, asked.encoding.decoded())?;
        return Ok(Source { picture, raw: None, recipe, lut: None, shot: None });
    }
    let lut = recipe_file::lut(&recipe)?;
    let picture = match (&raw, is_raw, asked.developed) {
        (Some(raw), true, true) => {
            developed::measured(&Developer::new(raw, &recipe, lut.clone()).map_err(ShotError::from)?.whole())
        }
        (Some(raw), true, false) => Measured::Raw(Box::new(raw.clone())),
        _ => Measured::read(&asked.file, asked.encoding.decoded())?,
    };
    // Raw values need no development.
    let raw = raw.filter(|_| !is_raw || asked.developed);
    Ok(Source { picture, raw, recipe, lut, shot })
}

/// The shot that a raw file was taken by: --shot, or the file beside it that `shoot --save-shot` wrote.
fn shot_of(asked: &MeasureMtf, path: &Path, raw: &RawImage) -> anyhow::Result<Option<Box<Shot>>> {
    let beside: PathBuf = asked.shot.clone().unwrap_or_else(|| path.with_extension("toml"));
    if asked.shot.is_none() && !beside.exists() {
        return Ok(None);
    }
    let mut file = ShotFile::read(&beside)?;
    file.render.quick = false;
    let mut shot = Shot::prepare(&file, &mut warn)?;
    watched("focusing", |w| shot.focus(w, &mut warn))?;
    watched("metering", |w| shot.meter(w, &mut warn))?;
    why::agree(path, raw, &shot)?;
    if asked.shot.is_none() {
        say(&format!("the shot is that of {}", beside.display()));
    }
    Ok(Some(Box::new(shot)))
}

/// The photograph that is to be taken of a scene or by a shot file; none where the file is a picture.
fn shot_of_chart(asked: &MeasureMtf) -> anyhow::Result<Option<ShotFile>> {
    let file = &asked.file;
    let embedded = asked.file.to_str().filter(|name| builtin::is_embedded(name) && !file.exists());
    let ending = file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let set = [
        ("--aperture", asked.aperture.is_some()),
        ("--focal-length", asked.focal_length.is_some()),
        ("--size", asked.size.is_some()),
        ("--spp", asked.spp.is_some()),
    ];
    let set = set.iter().find(|s| s.1).map(|s| s.0);
    let wrong = |what: String| Err(UsageError(anyhow!(what)).into());
    if ending == "toml" {
        let mut shot = ShotFile::read(file)?;
        let (camera, render) = (&mut shot.camera, &mut shot.render);
        if let (Some(lens), Some(body)) = (&asked.lens, &asked.body) {
            (camera.lens, camera.body) = (Some(lens.clone()), Some(body.clone()));
        }
        camera.focal_length = asked.focal_length.or(camera.focal_length);
        render.size = asked.size.or(render.size);
        render.spp = asked.spp.or(render.spp);
        shot.exposure.aperture = asked.aperture.or(shot.exposure.aperture);
        asked.developing.apply(&mut shot.develop)?;
        return Ok(Some(shot));
    }
    if embedded.is_none() && !(is_scene_file(file) && file.exists()) {
        return match set {
            Some(flag) => wrong(format!(
                "{flag} with {}: a picture says itself how it was taken; expected a scene (slanted-edges, chart.scene), a shot file, or no {flag}",
                name_of(file)
            )),
            None if asked.motion.is_some() && asked.lens.is_none() => {
                wrong("--motion without --lens: expected --lens and --body, whose chain it is a part of".into())
            }
            None => Ok(None),
        };
    }
    let Some(name) = file.to_str() else {
        return wrong(format!("{}: expected a name in UTF-8", file.display()));
    };
    if asked.motion.is_some() {
        let hint = "expected a picture, or a shot file, whose chart or camera moves";
        return wrong(format!("--motion with {name}: it is photographed without motion; {hint}"));
    }
    match (&asked.lens, &asked.body) {
        (Some(lens), Some(body)) => {
            let (aperture, focal_length) = (asked.aperture, asked.focal_length);
            let spp = asked.spp.unwrap_or(CHART_SPP);
            let mut shot = Setup { body, lens, aperture, focal_length, size: asked.size, spp }.shot_file(name);
            asked.developing.apply(&mut shot.develop)?;
            Ok(Some(shot))
        }
        _ => wrong(format!("{name}: this is a scene; expected --lens and --body to photograph it with, or a picture")),
    }
}

/// The camera of a picture: of the shot, or of --lens and --body; none without these, or where there is nothing to predict.
fn camera<'a>(
    asked: &'a MeasureMtf,
    source: &'a Source,
    channel: Channel,
    size: [usize; 2],
) -> anyhow::Result<Option<Predictor<'a>>> {
    let facts = source.raw.as_ref().map(|r| &r.header.facts).or(source.picture.facts());
    let mosaic = source.raw.as_ref().map_or(size, RawImage::size);
    let motion = match (asked.motion, &source.shot) {
        (Some(way), _) => Motion::Straight(way),
        (None, Some(shot)) => Motion::Of(shot),
        (None, None) => Motion::Straight([0.0; 2]),
    };
    let light = &asked.light;
    let unpredicted = |what: &str| {
        say(&format!("note: {}: {what}", name_of(&asked.file)));
        Ok(None)
    };
    if let (Some(lens), Some(body)) = (&asked.lens, &asked.body) {
        let from_shot = source.shot.as_ref().filter(|_| shot_names(source, lens, body));
        if from_shot.is_none() {
            let sensor = read_body(body)?;
            named_otherwise(&asked.file, &sensor, facts);
            let (lens, film_mm) = as_taken(&asked.file, lens, facts, mosaic)?;
            // As shots are taken by default.
            let film = diopter::Film::new(film_mm[0], film_mm[1], mosaic[0], mosaic[1]);
            let diffraction = diopter::expose::diffraction_shows(&Lens::Compound(Box::new(lens.clone())), &film);
            return Ok(Some(Predictor { lens, sensor, film_mm, size: mosaic, diffraction, motion, light }));
        }
    }
    let Some(shot) = &source.shot else {
        if channel == Channel::Luminance && source.raw.is_some() {
            return unpredicted("nothing is predicted without --lens and --body, or the shot file beside the raw file");
        }
        return Ok(None);
    };
    let film = &shot.camera.film;
    match &shot.camera.lens {
        Lens::Compound(lens) if film.center_mm == [0.0; 2] && !shot.camera.lens.is_tilted() => Ok(Some(Predictor {
            lens: (**lens).clone(),
            sensor: shot.sensor.clone(),
            film_mm: [film.width_mm, film.height_mm],
            size: mosaic,
            diffraction: shot.diffracts(),
            motion,
            light,
        })),
        Lens::Compound(_) => unpredicted("nothing is predicted for lenses that are shifted or tilted"),
        _ => unpredicted("nothing is predicted for ideal lenses: expected a prescription (--lens)"),
    }
}

/// Whether a shot was taken with a lens and a body.
fn shot_names(source: &Source, lens: &str, body: &str) -> bool {
    let camera = source.shot.as_ref().map(|s| &s.file().camera);
    camera.is_some_and(|c| c.lens.as_deref() == Some(lens) && c.body.as_deref() == Some(body))
}

/// Says where a picture was taken with another camera.
pub(super) fn named_otherwise(file: &Path, sensor: &Sensor, facts: Option<&ExposureFacts>) {
    if let Some(model) = facts.map(|f| &f.model).filter(|m| !m.is_empty() && !m.starts_with(sensor.model.as_str())) {
        say(&format!(
            "note: {} was taken with the camera \"{model}\", and is compared with \"{}\"",
            file.display(),
            sensor.model
        ));
    }
}

impl Predictor<'_> {
    fn predict(
        &self,
        asked: &MeasureMtf,
        source: &Source,
        channel: Channel,
        size: [usize; 2],
        edges: &[EdgeMtf],
        options: &Options,
    ) -> anyhow::Result<Predicted> {
        let Some(raw) = &source.raw else { return self.raw(channel, edges) };
        if !asked.developed {
            say("note: pictures that `shoot` wrote are denoised unless --denoise off: what that takes away is not predicted");
        }
        let development = Development { raw, recipe: &source.recipe, lut: source.lut.as_ref(), size };
        watched("developing the predicted edges", |_| self.developed(&development, channel, edges, options))
    }
}

/// Measured beside predicted, of developed pictures.
pub(super) fn developed_text(edges: &[EdgeMtf], predictions: &[Developed]) -> anyhow::Result<String> {
    let mut t = String::new();
    let Some(first) = predictions.first() else { return Ok(t) };
    let mean = |of: &dyn Fn(&EdgeMtf, &Developed) -> f64| {
        edges.iter().zip(predictions).map(|(e, p)| of(e, p)).sum::<f64>() / predictions.len() as f64
    };
    if edges.len() > 1 {
        writeln!(t, "  on average over {} edges:", edges.len())?;
    }
    write!(t, "  {:>12} {:>9} {:>9} {:>9}", "cycles/pixel", "measured", "predicted", "raw chain")?;
    first.steps.iter().try_for_each(|s| write!(t, " {:>15}", s.name))?;
    writeln!(t, " {:>11}", "difference")?;
    for k in (0..first.frequencies.len()).step_by(5).filter(|k| first.frequencies[*k] <= 0.5) {
        write!(
            t,
            "  {:>12.2} {:>9.4} {:>9.4} {:>9.4}",
            first.frequencies[k],
            mean(&|e, _| e.mtf[k]),
            mean(&|_, p| p.product[k]),
            mean(&|_, p| p.raw[k])
        )?;
        (0..first.steps.len()).try_for_each(|s| write!(t, " {:>15.4}", mean(&|_, p| p.steps[s].factor[k])))?;
        writeln!(t, " {:>+11.4}", mean(&|e, p| e.mtf[k] - p.product[k]))?;
    }
    writeln!(t, "  measured less predicted, largest up to half a cycle a pixel:")?;
    for (e, p) in edges.iter().zip(predictions) {
        let [difference, at] = p.largest_difference;
        let [x, y] = e.middle;
        writeln!(t, "    edge at {x:.0},{y:.0}: {difference:+.4} at {at:.2}")?;
    }
    first.notes.iter().try_for_each(|note| writeln!(t, "  {note}"))?;
    Ok(t)
}

/// Responses of some edges, and what was predicted for them (the same number, or none).
pub(super) fn figure(name: &str, channel: Channel, per_mm: Option<f64>, edges: &[EdgeMtf], predictions: &[&[f64]]) -> Figure {
    let scale = per_mm.unwrap_or(1.0);
    let lines = edges.iter().take(COLORS.len()).enumerate().map(|(k, e)| {
        let name = format!("{:.0},{:.0}: {:.1}°", e.middle[0], e.middle[1], e.angle_deg);
        line(name, k, Style::Full, e.frequencies.iter().zip(&e.mtf).map(|(f, m)| (f * scale, m.min(1.2))))
    });
    let chains = edges.iter().zip(predictions).take(COLORS.len()).enumerate().map(|(k, (e, p))| {
        let name = if k == 0 { "predicted" } else { "" };
        line(name, k, Style::Broken, e.frequencies.iter().zip(*p).map(|(f, m)| (f * scale, m.min(1.2))))
    });
    let unit = if per_mm.is_some() { "cycles/mm" } else { "cycles/pixel" };
    let nyquist = line("", 5, Style::Broken, [(0.5 * scale, 0.0), (0.5 * scale, 1.2)]);
    sheet(&Chart {
        title: format!("e-SFR, {name}, {}", channel.name()),
        x: Axis { label: format!("spatial frequency across the edge, {unit}"), range: [0.0, scale] },
        y: Axis { label: "contrast".into(), range: [0.0, 1.2] },
        lines: lines.chain(chains).chain([nyquist]).collect(),
    })
}

pub(super) fn text(
    name: &str,
    edges: &[EdgeMtf],
    channel: Channel,
    per_mm: Option<f64>,
    height: usize,
) -> anyhow::Result<String> {
    let mut t = String::new();
    writeln!(t, "{name}, {}   (e-SFR, ISO 12233; frequencies in cycles/pixel)", channel.name())?;
    let mm = if per_mm.is_some() { format!(" {:>9}", "per mm") } else { String::new() };
    writeln!(
        t,
        "  {:<22} {:>8} {:>9} {:>6} {:>7}{mm} {:>7} {:>7} {:>8}",
        "region x,y,w,h", "angle", "contrast", "noise", "MTF50", "LW/PH", "MTF10", "Nyquist"
    )?;
    let number = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    for e in edges {
        let r = e.region;
        let place = format!("{},{},{},{}", r.x, r.y, r.width, r.height);
        let mm = per_mm.map_or(String::new(), |s| format!(" {:>9}", number(e.mtf50.map(|f| f * s), 2)));
        writeln!(
            t,
            "  {place:<22} {:>7.2}{} {:>9.3} {:>5.1}% {:>7}{mm} {:>7} {:>7} {:>8.3}",
            e.angle_deg,
            if e.horizontal { "-" } else { "|" },
            e.contrast,
            100.0 * e.noise,
            number(e.mtf50, 4),
            number(e.mtf50.map(|f| 2.0 * f * height as f64), 0),
            number(e.mtf10, 4),
            e.at_nyquist
        )?;
    }
    if let [only] = edges {
        let mm = if per_mm.is_some() { "cycles/mm" } else { "" };
        writeln!(t, "  {:>12} {:>9} {mm:>10}", "cycles/pixel", "contrast")?;
        for k in 0..=20 {
            let f = f64::from(k) * 0.05;
            let mm = per_mm.map_or(String::new(), |s| format!("{:.2}", f * s));
            writeln!(t, "  {f:>12.2} {:>9.4} {mm:>10}", only.at(f))?;
        }
    }
    Ok(t)
}

/// Measured beside predicted.
pub(super) fn chain_text(edges: &[EdgeMtf], predictions: &[Prediction]) -> anyhow::Result<String> {
    let mut t = String::new();
    if let [p, ..] = predictions {
        // Of all edges, on average.
        let mean = |of: &dyn Fn(&EdgeMtf, &Prediction) -> f64| {
            edges.iter().zip(predictions).map(|(e, p)| of(e, p)).sum::<f64>() / edges.len() as f64
        };
        if edges.len() > 1 {
            writeln!(t, "  on average over {} edges:", edges.len())?;
        }
        writeln!(
            t,
            "  {:>12} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>11}",
            "cycles/pixel",
            "measured",
            "predicted",
            "lens",
            "aperture",
            "low-pass",
            "crosstalk",
            "motion",
            "window",
            "shading",
            "difference"
        )?;
        for k in (0..p.frequencies.len()).step_by(5).filter(|k| p.frequencies[*k] <= 0.5) {
            writeln!(
                t,
                "  {:>12.2} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>9.4} {:>+11.4}",
                p.frequencies[k],
                mean(&|e, _| e.mtf[k]),
                mean(&|_, p| p.windowed[k]),
                mean(&|_, p| p.lens[k]),
                mean(&|_, p| p.aperture[k]),
                mean(&|_, p| p.low_pass[k]),
                mean(&|_, p| p.crosstalk[k]),
                mean(&|_, p| p.motion[k]),
                mean(&|_, p| if p.product[k] > 0.0 { p.windowed[k] / (p.product[k] * p.shading[k]) } else { 1.0 }),
                mean(&|_, p| p.shading[k]),
                mean(&|e, p| e.mtf[k] - p.windowed[k])
            )?;
        }
    }
    writeln!(t, "  measured less predicted, largest up to half a cycle a pixel:")?;
    for (e, p) in edges.iter().zip(predictions) {
        let [difference, at] = p.largest_difference;
        let [x, y] = e.middle;
        writeln!(t, "    edge at {x:.0},{y:.0} ({:.2} mm from the middle): {difference:+.4} at {at:.2}", p.height_mm)?;
    }
    Ok(t)
}
