//! `read-out`: a focal plane into raw files.

use super::body::body_of;
use super::{light, open, print_json, read_plane};
use crate::UsageError;
use crate::args::ReadOut;
use crate::output::{self, now};
use crate::watch::{say, warn};
use anyhow::{Context, anyhow};
use diopter::develop::Recipe;
use diopter::image::dng;
use diopter::image::exr::FocalPlaneRows;
use diopter::image::{ImageError, RawHeader};
use diopter::sensor::Window;
use diopter::shot::white_point;
use diopter::{raw_file, truth};
use std::path::Path;

/// Pixels of a plane up to which it is kept in memory for several read-outs.
const KEPT_PIXELS: usize = 50_000_000;

/// Rows beyond those that are read out, for what neighbours give.
const HALO: usize = 1;

/// Most raw files of one run: as many as a film has frames.
const MOST_SHOTS: usize = 1_000_000;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &ReadOut, json: bool) -> anyhow::Result<()> {
    if args.shots.get() > MOST_SHOTS {
        let wrong =
            anyhow!("shots {}: expected 1 to {MOST_SHOTS}; more are several runs, each with a --seed of its own", args.shots);
        return Err(UsageError(wrong).into());
    }
    let names = output::numbered(&args.output, args.shots.get());
    output::distinct([args.plane.as_path()], names.iter().chain(&args.truth).map(|p| p.as_path()))?;
    if light::is_asked(args) {
        return light::run(args, &names, json);
    }
    // One proves that the others can be written; thousands are not opened at once.
    let mut ready = Some(output::prepare_dng(&names[0])?);
    let truth_file = args.truth.as_deref().map(output::prepare_exr).transpose()?;
    let place = || args.plane.display().to_string();
    let first = open_rows(&args.plane)?;
    let sensor = body_of(args, &first.facts().body)?;
    if args.body.is_some() && !first.facts().body.is_empty() && first.facts().body != sensor.name {
        warn(&format!(
            "{}: its electrons were counted by {}: of {} it gets the noise, gains and levels, not the colours and the sensitivity; `expose --bands 400..700/10nm` keeps light for any body",
            place(),
            first.facts().body,
            sensor.name
        ));
    }
    // What the camera was set to, if it is this body that reads.
    let own = Some(first.facts()).filter(|_| args.body.is_none());
    let wanted = args.asked();
    let reading = |k: usize| wanted.reading(&sensor, own, args.seed.wrapping_add(k as u64));
    let white = white_point(&reading(0).white)?;
    let asked = |e| anyhow::Error::from(UsageError(anyhow::Error::from(e).context(place())));
    let date = now();
    let prepare = |k: usize| {
        let time = first.facts().exposure_s;
        let reader = diopter::sensor::ReadOut::new(&sensor, &reading(k), first.size(), first.bands(), time).map_err(asked)?;
        anyhow::Ok(reader.with_rows_of(first.facts()))
    };
    let line = prepare(0)?.numbers_per_row();

    let [width, height] = first.size();
    let whole = names.len() > 1 && width * height <= KEPT_PIXELS;
    let kept = if whole { Some(open_rows(&args.plane)?.next(height).with_context(place)?) } else { None };
    let mut written = Vec::new();
    let mut statistics = Statistics::default();
    for (k, name) in names.iter().enumerate() {
        let output = match ready.take() {
            Some(output) => output,
            None => output::prepare_dng(name)?,
        };
        let reader = prepare(k)?;
        let mut header = reader.header(first.facts(), &white);
        header.facts.date = Some(date.clone());
        statistics = Statistics::default();
        let mut plane = match &kept {
            Some(rows) => Plane::Kept(rows),
            None => Plane::Streamed(Box::new(Streamed::new(open_rows(&args.plane)?))),
        };
        // Charge that blooms runs along whole columns: all of it is counted before any of it is read.
        let mut electrons = Vec::new();
        if sensor.blooming {
            electrons = vec![0.0; line * height];
            for (band, rows) in electrons.chunks_mut(line * BAND).enumerate() {
                let window = plane.window(band * BAND, rows.len() / line).with_context(place)?;
                reader.electrons(&window, band * BAND, rows);
            }
            reader.bloom(&mut electrons);
        }
        // What fails may be the plane, whose fault the DNG's name must not take.
        let mut unread = None;
        let mut rows = |first: usize, band: &mut [u16]| -> Result<(), ImageError> {
            match sensor.blooming {
                true => reader.numbers(first, &electrons[first * line..][..band.len()], band),
                false => match plane.window(first, band.len() / line) {
                    Ok(window) => reader.rows(&window, first, band),
                    Err(e) => {
                        unread = Some(e);
                        return Err(std::io::Error::other("the focal plane cannot be read").into());
                    }
                },
            }
            statistics.add(band, &header);
            Ok(())
        };
        let path = output
            .commit(|to| Ok(raw_file::write(&header, [line, height], args.raw.storage(), &mut rows, &Recipe::default(), to)?));
        if let Some(e) = unread {
            return Err(anyhow::Error::from(e).context(place()));
        }
        written.push(path?);
    }
    if let Some(output) = truth_file {
        let plane = read_plane(&args.plane)?;
        let raw = dng::read(open(&written[0])?).with_context(|| written[0].display().to_string())?;
        let (reader, layout) = (prepare(0)?, args.truth_layout.layout());
        written.extend(output::write_truth(output, plane.truth.recorded(), args.truth_sidecar, |recorded, to| {
            truth::write(&plane, &reader, &raw, layout, recorded, to)
        })?);
    }
    let header = prepare(0)?.header(first.facts(), &white);
    say(&format!(
        "{}   ISO {:.0}   {:.0} °C   serial {}   seed {}",
        sensor.name,
        header.facts.iso,
        header.facts.temperature_c.unwrap_or(0.0),
        header.facts.serial,
        args.seed
    ));
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&serde_json::json!({
            "files": written, "facts": header.facts, "black_level": header.black_level, "white_level": header.white_level,
            "mean_dn": statistics.sum / statistics.count, "saturated": statistics.saturated / statistics.count,
            "as_shot_neutral": header.as_shot_neutral, "noise_profile": header.noise, "cfa": header.cfa.letters(),
        }))?;
    }
    Ok(())
}

/// Rows counted at a time where charge blooms.
const BAND: usize = 256;

/// Rows of a plane, from memory or from its file.
enum Plane<'a> {
    Kept(&'a [f32]),
    Streamed(Box<Streamed>),
}

/// A plane that goes by, row after row.
struct Streamed {
    source: FocalPlaneRows,
    /// First row of what is held.
    from: usize,
    held: Vec<f32>,
}

impl Streamed {
    fn new(source: FocalPlaneRows) -> Self {
        Streamed { source, from: 0, held: Vec::new() }
    }
}

impl Plane<'_> {
    /// Some rows and their neighbours; of a plane that goes by, later ones each time.
    fn window(&mut self, first: usize, count: usize) -> Result<Window<'_>, ImageError> {
        match self {
            Plane::Kept(data) => Ok(Window { first: 0, data }),
            Plane::Streamed(s) => {
                let [width, height] = s.source.size();
                let stride = width * s.source.bands().len();
                let begin = first.saturating_sub(HALO);
                s.held.drain(..(begin - s.from) * stride);
                s.from = begin;
                let missing = (first + count + HALO).min(height) - (begin + s.held.len() / stride);
                s.held.extend(s.source.next(missing)?);
                Ok(Window { first: begin, data: &s.held })
            }
        }
    }
}

/// Of the numbers of a read-out.
#[derive(Default)]
struct Statistics {
    sum: f64,
    count: f64,
    saturated: f64,
}

impl Statistics {
    fn add(&mut self, band: &[u16], header: &RawHeader) {
        self.count += band.len() as f64;
        self.sum += band.iter().map(|d| f64::from(*d)).sum::<f64>();
        self.saturated += band.iter().filter(|d| f64::from(**d) >= header.white_level).count() as f64;
    }
}

fn open_rows(path: &Path) -> anyhow::Result<FocalPlaneRows> {
    FocalPlaneRows::open(open(path)?).with_context(|| path.display().to_string())
}
