//! `why`: what softens a place of a picture, what makes it as bright and as noisy as it is, and what would change it.
//!
//! Answered by the camera's model ([`diopter::why`]), so the shot must be known. A raw file names camera and exposure, but not the scene and the place of the
//! camera: its shot file (`shoot --save-shot`) stands beside it and is held against what the raw file says.

use super::{print_json, read_raw, shown};
use crate::UsageError;
use crate::args;
use crate::document::{self, Block, Document};
use crate::output::{self, Kind};
use crate::watch::{say, warn, watched};
use anyhow::anyhow;
use diopter::develop::Developer;
use diopter::image::{Picture, PictureSource, RawImage};
use diopter::quantity::Size;
use diopter::shot::{Sequence, Shot, ShotError, ShotFile};
use diopter::why::{Why, why};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Longer side of the picture on the page, pixels, and its samples where it is taken for the page.
const PICTURE: usize = 640;
const PICTURE_SPP: u32 = 16;
/// Relative difference up to which a raw file and a shot file say the same: EXIF has fractions.
const SAME: f64 = 5e-3;

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending))
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(asked: &args::Why, json: bool) -> anyhow::Result<()> {
    if let Some(path) = asked.output.as_deref().filter(|p| document::kind(p).is_none()) {
        return Err(UsageError(anyhow!("{}: expected a name that ends in .html or .pdf", path.display())).into());
    }
    let raw = if has_ending(&asked.subject, "dng") { Some(read_raw(&asked.subject)?) } else { None };
    let mut file = shot_file(asked, raw.is_some())?;
    if Sequence::new(&mut file)?.count() > 1 {
        warn("the shot asks for several pictures: the first is looked at");
    }
    if file.render.quick {
        warn("a quick look has no rays through the lens: the picture is looked at as it would be taken without it");
        file.render.quick = false;
    }
    let output = asked.output.as_deref().map(document::prepare).transpose()?;
    let mut shot = Shot::prepare(&file, &mut warn)?;
    // As `shoot` takes the files that the shot asks for.
    let is_looked_at = |path: &PathBuf| output::kind(path).is_ok_and(Kind::is_looked_at);
    if raw.is_none() && file.output.files.iter().all(is_looked_at) {
        shot.sample_pictures_in_full_color();
    }
    let report = watched("focusing", |w| shot.focus(w, &mut warn))?;
    watched("metering", |w| shot.meter(w, &mut warn))?;
    if let Some(raw) = &raw {
        agree(&asked.subject, raw, &shot)?;
    }
    let found = watched("tracing", |_| why(&shot, asked.at, report.as_ref()))?;
    let name = asked.subject.display().to_string();
    let counted = raw.as_ref().and_then(|raw| counted(raw, &shot, found.pixel));
    let text = text(&name, &found, counted)?;
    let mut written = None;
    if let Some(output) = output {
        let picture = match &raw {
            Some(raw) => reduced(raw, &shot)?,
            None => taken(&file, &shot)?,
        };
        let path = page(&name, &found, &text, picture).write(output)?;
        say(&format!("wrote {}", path.display()));
        written = Some(path);
    }
    if json {
        let mut told = serde_json::to_value(&found)?;
        told["file"] = serde_json::json!(written);
        told["raw"] = serde_json::json!(counted.map(|[dn, electrons]| serde_json::json!({ "dn": dn, "electrons": electrons })));
        return print_json(&told);
    }
    Ok(write!(std::io::stdout(), "{text}")?)
}

/// The shot that is asked about.
fn shot_file(asked: &args::Why, is_raw: bool) -> anyhow::Result<ShotFile> {
    let subject = &asked.subject;
    if !is_raw {
        if asked.shot.is_some() {
            let wrong = anyhow!("--shot belongs to a raw file: expected PHOTO.dng beside it, found {}", subject.display());
            return Err(UsageError(wrong).into());
        }
        if has_ending(subject, "toml") {
            return Ok(ShotFile::read(subject)?);
        }
        if ["jpg", "jpeg", "png", "tif", "tiff", "exr", "html"].iter().any(|e| has_ending(subject, e)) {
            let wrong = anyhow!(
                "{}: a picture does not say how it was taken; expected its shot file (shoot --save-shot SHOT.toml), or a raw file with it beside",
                subject.display()
            );
            return Err(UsageError(wrong).into());
        }
        let mut shot = ShotFile::default();
        shot.scene.file = Some(subject.display().to_string());
        return Ok(shot);
    }
    let beside: PathBuf = asked.shot.clone().unwrap_or_else(|| subject.with_extension("toml"));
    if asked.shot.is_none() && !beside.exists() {
        let wrong = anyhow!(
            "{}: a raw file holds neither the scene nor where the camera stood; expected the shot file {} beside it, or --shot FILE \
             (shoot ... -o {} --save-shot {} writes it)",
            subject.display(),
            beside.display(),
            subject.display(),
            beside.display()
        );
        return Err(UsageError(wrong).into());
    }
    Ok(ShotFile::read(&beside)?)
}

/// Fails where a raw file was taken otherwise than the shot says.
pub(super) fn agree(path: &Path, raw: &RawImage, shot: &Shot) -> anyhow::Result<()> {
    let (file, ours) = (&raw.header.facts, shot.facts());
    let film = &shot.camera.film;
    let size = raw.size();
    let differ = |what: &str, found: String, expected: String| -> anyhow::Result<()> {
        let wrong = anyhow!(
            "{}: {what} {found}; expected {expected}, as the shot file says: it belongs to another picture",
            path.display()
        );
        Err(UsageError(wrong).into())
    };
    if size != [film.columns, film.rows] {
        return differ("pixels", format!("{} × {}", size[0], size[1]), format!("{} × {}", film.columns, film.rows));
    }
    // Letters of which all files are certain.
    let plain = |s: &str| s.chars().filter(char::is_ascii_alphanumeric).collect::<String>();
    let names = [
        ("of camera", file.model.trim_end_matches(" (simulated)"), shot.sensor.model.as_str()),
        ("through lens", file.lens.as_str(), ours.lens.as_str()),
    ];
    for (what, found, expected) in names {
        if !found.is_empty() && plain(found) != plain(expected) {
            return differ(what, format!("\"{found}\""), format!("\"{expected}\""));
        }
    }
    let numbers = [
        ("f-number", file.f_number, ours.f_number),
        ("exposure time", file.exposure_s, ours.exposure_s),
        ("ISO speed", file.iso, ours.iso),
        ("focal length", file.focal_length_mm, ours.focal_length_mm),
    ];
    for (what, found, expected) in numbers {
        if found > 0.0 && (found / expected - 1.0).abs() > SAME {
            return differ(what, shown(found), shown(expected));
        }
    }
    Ok(())
}

/// What a raw file counted in a pixel: DN, and electrons by the gain of the shot.
fn counted(raw: &RawImage, shot: &Shot, [column, row]: [usize; 2]) -> Option<[f64; 2]> {
    // Where it has all channels, that of its filter in the mosaic.
    let samples = raw.header.cfa.samples_per_pixel();
    let sample = if samples > 1 { shot.sensor.cfa.channel_at(column, row) } else { 0 };
    let dn = f64::from(*raw.mosaic.pixel(column * samples + sample, row).first()?);
    let step = shot.sensor.at_iso(shot.reading.iso).ok()?;
    Some([dn, (dn - raw.header.black_level) * step.gain_e_per_dn])
}

/// The developed raw file, in small.
fn reduced(raw: &RawImage, shot: &Shot) -> anyhow::Result<Picture> {
    let mut recipe = shot.recipe.clone();
    recipe.resize = Default::default();
    recipe.resize.long_edge = Some(PICTURE.min(raw.size()[0].max(raw.size()[1])) as u32);
    Ok(Developer::new(raw, &recipe, shot.lut.clone()).map_err(ShotError::from)?.whole())
}

/// The picture of a shot, in small: with everything set as it was found.
fn taken(file: &ShotFile, shot: &Shot) -> anyhow::Result<Picture> {
    let mut small = file.clone();
    shot.write_resolved(&mut small);
    let film = &shot.camera.film;
    let scale = (PICTURE as f64 / film.columns.max(film.rows) as f64).min(1.0);
    let side = |n: usize| ((n as f64 * scale).round() as usize).max(1);
    small.render.size = Some(Size { width: side(film.columns), height: side(film.rows) });
    (small.render.spp, small.render.samples) = (Some(PICTURE_SPP), None);
    small.develop.resize = Default::default();
    let mut quiet = |_: &str| ();
    let mut shot = Shot::prepare(&small, &mut quiet)?;
    shot.prepare_pictures(false, &mut quiet)?;
    watched("focusing", |w| shot.focus(w, &mut quiet))?;
    watched("metering", |w| shot.meter(w, &mut quiet))?;
    let exposed = watched("exposing", |w| shot.expose_from(None, w, None))?;
    let plane = shot.for_pictures(&exposed)?.unwrap_or(exposed.plane);
    Ok(shot.develop(&shot.read_out(&plane)?)?)
}

/// "+31 %", "-4 %".
fn percent(ratio: f64) -> String {
    format!("{:+.0} %", 100.0 * (ratio - 1.0))
}

fn heading(found: &Why) -> String {
    let s = &found.shown;
    let what = s.object.as_ref().map_or("nothing but sky".to_owned(), |name| format!("\"{name}\""));
    let distance = s.distance_m.map_or(String::new(), |m| format!(", {} m away", shown(m)));
    let focus = found.facts.focus_distance_m.map_or("infinity".to_owned(), |m| format!("{} m", shown(m)));
    let [x, y] = found.at;
    let [column, row] = found.pixel;
    format!("At {x:.3},{y:.3} (pixel {column},{row}): {what}{distance}; focused at {focus}.")
}

fn blur_text(found: &Why) -> Result<String, std::fmt::Error> {
    let b = &found.blur;
    let mut text = String::new();
    let frequency = b.mtf50_per_px.zip(b.mtf50_per_mm);
    let frequency = frequency.map_or(String::new(), |(px, mm)| format!("; MTF50 {px:.3} cycles/pixel, {mm:.1} cycles/mm"));
    writeln!(text, "Blur radius {:.2} µm, {:.2} pixels of {:.2} µm{frequency}", b.radius_um, b.radius_px, found.pitch_um)?;
    if b.widest_um > 1.05 * b.radius_um {
        writeln!(text, "  widest at {:.0}° from right towards up: {:.2} µm", b.widest_deg, b.widest_um)?;
    }
    writeln!(text, "  {:<24} {:>7} {:>9} {:>9} {:>12}", "cause", "fraction", "µm", "pixels", "without, µm")?;
    for c in &found.causes {
        let note = c.note.as_ref().map_or(String::new(), |n| format!("  ({n})"));
        writeln!(
            text,
            "  {:<24} {:>5.1} % {:>9.2} {:>9.3} {:>12.2}{note}",
            c.name,
            100.0 * c.fraction,
            c.radius_um,
            c.radius_px,
            c.without.radius_um
        )?;
    }
    Ok(text)
}

fn brightness_text(found: &Why, counted: Option<[f64; 2]>) -> Result<String, std::fmt::Error> {
    let b = &found.brightness;
    let mut text = String::new();
    let codes = b.codes.map(|c| format!("{:.0}", 255.0 * c)).join(",");
    writeln!(
        text,
        "Developed luminance {:.4} of white (codes {codes} of 255); {:.1} % of saturation",
        b.value,
        100.0 * b.of_saturation
    )?;
    writeln!(text, "  {:<36} {:>11} {:>11} {:<6}", "", "factor", "product", "")?;
    writeln!(text, "  {:<36} {:>11} {:>11} {:<6}", "luminance of the scene", "", shown(b.luminance), "cd/m²")?;
    for f in &b.factors {
        writeln!(text, "  {:<36} {:>11} {:>11} {:<6} {}", f.name, shown(f.factor), shown(f.product), f.unit, f.because)?;
    }
    if let Some([dn, electrons]) = counted {
        writeln!(text, "  The raw file reads {dn:.0} DN there: {electrons:.0} e⁻ with its noise and pattern.")?;
    }
    Ok(text)
}

fn noise_text(found: &Why) -> Result<String, std::fmt::Error> {
    let n = &found.noise;
    let mut text = String::new();
    let full = if n.clipped { "; the pixel is full" } else { "" };
    writeln!(
        text,
        "Noise {:.2} e⁻ of {:.1} e⁻, signal to noise {:.1}{full}",
        n.total_e, found.brightness.electrons, n.signal_to_noise
    )?;
    if n.total_e > 1.01 * n.camera_e {
        let s = n.camera_signal_to_noise;
        writeln!(text, "  without the renderer's own, as of a real camera: {:.2} e⁻, signal to noise {s:.1}", n.camera_e)?;
    }
    writeln!(text, "  {:<46} {:>10} {:>8}", "", "e⁻", "fraction")?;
    for t in &n.terms {
        writeln!(text, "  {:<46} {:>10.3} {:>6.1} %  {}", t.name, t.electrons, 100.0 * t.fraction, t.kind)?;
    }
    Ok(text)
}

fn advice_text(found: &Why) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for a in &found.advice {
        let brightness = match a.brightness_ev {
            0.0 => String::new(),
            ev => format!(", {:.1} EV {}", ev.abs(), if ev > 0.0 { "brighter" } else { "darker" }),
        };
        let noise = if a.noise.is_nan() { "–".to_owned() } else { format!("×{:.2}", a.noise) };
        writeln!(text, "  {:<44} blur {:>7}, noise {noise} (ISO {:.0}{brightness})", a.change, percent(a.blur), a.iso)?;
    }
    Ok(text)
}

fn text(name: &str, found: &Why, counted: Option<[f64; 2]>) -> anyhow::Result<String> {
    let mut text = format!("{name}\n{}\n\n{}\n", heading(found), blur_text(found)?);
    write!(text, "{}\n{}", brightness_text(found, counted)?, noise_text(found)?)?;
    if !found.advice.is_empty() {
        write!(text, "\nWhat would change it (noise over signal)\n{}", advice_text(found)?)?;
    }
    for note in &found.notes {
        writeln!(text, "\nNote: {note}.")?;
    }
    Ok(text)
}

/// The answer as a page that holds its picture.
fn page(name: &str, found: &Why, text: &str, picture: Picture) -> Document {
    let mut page = Document { title: format!("Why is {name} as it is?"), ..Document::default() };
    page.paragraph(&heading(found));
    page.blocks.push(Block::Picture { picture: picture.into(), marked: Some(found.at) });
    page.heading("What softens it");
    page.blocks.push(Block::Bars(found.causes.iter().map(|c| (c.name.to_owned(), c.fraction)).collect()));
    page.heading("What its noise consists of");
    page.blocks.push(Block::Bars(found.noise.terms.iter().map(|t| (t.name.to_owned(), t.fraction)).collect()));
    page.section("All numbers", &[], text);
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_told_in_percent() {
        assert_eq!([percent(0.69), percent(1.4)], ["-31 %", "+40 %"]);
    }
}
