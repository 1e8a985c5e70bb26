//! `sheet`, and `shoot --vary ... --sheet`: one shot with a setting varied, as a contact sheet. What pictures share is done once: the scene is read
//! once, pictures that differ only in ISO speed, noise or white share an exposure, and those that differ only in their development a raw image.

use super::exposure_summary::setting;
use super::print_json;
use crate::UsageError;
use crate::args::{Sheet, Shoot};
use crate::contact_sheet::{self, Below, Cell, ContactSheet, Kind};
use crate::memory;
use crate::output::{self, Output};
use crate::own_program::OwnProgram;
use crate::watch::{self, say, warn, watched};
use anyhow::{Context, anyhow};
use diopter::develop::Developer;
use diopter::image::{ExposureFacts, FocalPlane, Picture, PictureSource, RawImage};
use diopter::memory::Bytes;
use diopter::metering::ev100_of_setting;
use diopter::sensor::ColorSampling;
use diopter::sheet::{Cells, SheetFile, Table};
use diopter::shot::{ExposureUse, FireflyChoice, Inputs, SceneCache, Sequence, Shot, ShotError, ShotFile};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Instant;

/// Longer side of pictures by default, px.
const CELL: usize = 480;
/// Numbers of focal planes that are kept for other pictures (16 bytes each with errors and truth).
const KEPT_NUMBERS: usize = 50_000_000;

/// Renders the contact sheet that a sheet file describes. Fails with what the user is told.
pub fn run(args: &Sheet, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let mut file = SheetFile::read(&args.sheet)?;
    file.shot.render.size = args.size.or(file.shot.render.size);
    file.shot.render.spp = args.spp.or(file.shot.render.spp);
    output::distinct([args.sheet.as_path()], args.output.iter().map(PathBuf::as_path))?;
    let cells = file.cells(args.sheet.parent())?;
    let outputs = contact_sheet::prepare(&args.output)?;
    // An empty path is not the folder it stands for.
    let folder = args.sheet.parent().filter(|f| !f.as_os_str().is_empty());
    make(&file, &cells, folder, outputs, args.max_memory, json)
}

/// Renders the contact sheet of the flags of `shoot`; `shot` is what they say.
pub fn of_shot(args: &Shoot, shot: ShotFile, json: bool) -> anyhow::Result<()> {
    let file = SheetFile {
        title: args.sheet_title.clone(),
        columns: args.sheet_columns,
        cell: args.sheet_cell,
        crop: args.sheet_crop,
        histogram: args.sheet_histogram,
        vary: args.vary.clone(),
        table: args.sheet_table.iter().map(|c| Table { command: c.clone(), caption: None }).collect(),
        shot,
        ..Default::default()
    };
    let subject = args.taking.subject.as_deref().map(Path::new);
    output::distinct(subject, args.sheet.iter().map(PathBuf::as_path))?;
    let cells = file.cells(None)?;
    let outputs = contact_sheet::prepare(&args.sheet)?;
    make(&file, &cells, None, outputs, args.taking.max_memory, json)
}

fn make(
    file: &SheetFile,
    cells: &Cells,
    folder: Option<&Path>,
    outputs: Vec<(Kind, Output)>,
    max_memory: Option<Bytes>,
    json: bool,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let demosaic = cells.cells.first().map(|cell| &cell.shot.develop.demosaic);
    let compares_demosaicing = cells.cells.iter().any(|cell| Some(&cell.shot.develop.demosaic) != demosaic);
    let mut shared =
        Shared { scenes: SceneCache::new(), planes: Vec::new(), last: None, exposures: 0, compares_demosaicing, max_memory };
    let (mut painted, mut told) = (Vec::new(), Vec::new());
    let count = cells.cells.len();
    let below = Below { crop: file.crop, histogram: file.histogram };
    // What cannot be taken is said before anything is exposed.
    for (k, cell) in cells.cells.iter().enumerate() {
        shared.check(&cell.shot).with_context(|| format!("picture {} of {count}, {}", k + 1, cell.label))?;
    }
    let program = OwnProgram::new(None)?;
    let tables = file.table.iter().map(|table| {
        let text = program.run(&table.command, folder)?;
        Ok((table.caption.clone().unwrap_or_else(|| table.command.clone()), text.trim_end().to_owned()))
    });
    let tables = tables.collect::<anyhow::Result<Vec<(String, String)>>>()?;
    for (k, cell) in cells.cells.iter().enumerate() {
        let mut quiet = |_: &str| ();
        let odd: &mut dyn FnMut(&str) = if k == 0 { &mut warn } else { &mut quiet };
        let (whole, reduced, facts) = shared.picture(&cell.shot, file.cell.unwrap_or(CELL), odd)?;
        say(&format!("{} of {count}: {}   {}", k + 1, cell.label, setting(&facts)));
        told.push(serde_json::json!({ "label": cell.label, "facts": facts, "size": [whole.pixels.width, whole.pixels.height] }));
        let picture = contact_sheet::compose(reduced.as_ref().unwrap_or(&whole), &whole, below);
        painted.push(Cell { picture, label: cell.label.clone(), facts: caption(&facts) });
    }
    let title = file.title.clone().unwrap_or_default();
    let sheet = ContactSheet { title, text: file.text.clone(), columns: cells.columns, cells: painted, tables };
    let columns = sheet.columns();
    let written = sheet.write(outputs)?;
    written.iter().for_each(|path| say(&format!("wrote {}", path.display())));
    if json {
        print_json(&serde_json::json!({
            "files": written, "cells": told, "columns": columns, "tables": sheet.tables.iter().map(|t| &t.1).collect::<Vec<_>>(), "exposures": shared.exposures,
            "total_s": started.elapsed().as_secs_f64(),
        }))?;
    }
    Ok(())
}

/// Time, aperture, speed and exposure value.
fn caption(facts: &ExposureFacts) -> String {
    // EV of the setting, whatever the ISO speed: log2 (N² / t) (ISO 2720).
    let ev = ev100_of_setting(facts.f_number, facts.exposure_s, 100.0);
    format!("{}   EV {ev:.1}", setting(facts))
}

/// What pictures of a sheet share.
struct Shared {
    /// The scene of the last picture, read and built.
    scenes: SceneCache,
    /// Exposures by what decides them, the latest last.
    planes: Vec<(String, Rc<FocalPlane>)>,
    /// What was shot last, without its development.
    last: Option<(ShotFile, Shot, RawImage)>,
    /// How many were exposed.
    exposures: usize,
    /// Whether they differ in how they are demosaiced: then all are of a mosaic.
    compares_demosaicing: bool,
    max_memory: Option<Bytes>,
}

impl Shared {
    /// Fails where a picture cannot be taken: its settings, lens, body and scene.
    fn check(&mut self, file: &ShotFile) -> anyhow::Result<()> {
        let mut single = file.clone();
        if Sequence::new(&mut single)?.count() > 1 {
            let wrong = anyhow!("the shot asks for a sequence: expected single pictures on a sheet; a varied --at shows moments");
            return Err(UsageError(wrong).into());
        }
        file.develop.check().map_err(ShotError::from)?;
        diopter::recipe_file::lut(&file.develop)?;
        Shot::prepare_cached(&single, Inputs::default(), &mut self.scenes, &mut |_| ())?;
        Ok(())
    }

    /// The developed picture, the same reduced to `cell` px where it is larger, and how it was taken. `warn` gets what was found odd.
    fn picture(
        &mut self,
        file: &ShotFile,
        cell: usize,
        warn: &mut dyn FnMut(&str),
    ) -> anyhow::Result<(Picture, Option<Picture>, ExposureFacts)> {
        let mut asked = file.clone();
        asked.develop = Default::default();
        asked.output = Default::default();
        let same = self.last.take().filter(|l| l.0 == asked);
        let (asked, shot, raw) = match same {
            Some(last) => last,
            None => {
                let (shot, raw) = self.take(file, warn)?;
                (asked, shot, raw)
            }
        };
        file.develop.check().map_err(ShotError::from)?;
        let lut = diopter::recipe_file::lut(&file.develop)?;
        let develop = |recipe: &diopter::develop::Recipe| -> anyhow::Result<Picture> {
            Ok(Developer::new(&raw, recipe, lut.clone()).map_err(ShotError::from)?.whole())
        };
        let whole = develop(&file.develop)?;
        let reduced = match whole.pixels.width.max(whole.pixels.height) > cell {
            true => {
                let mut small = file.develop.clone();
                small.resize = Default::default();
                small.resize.long_edge = Some(cell as u32);
                Some(develop(&small)?)
            }
            false => None,
        };
        let facts = ExposureFacts { date: None, ..raw.header.facts.clone() };
        self.last = Some((asked, shot, raw));
        Ok((whole, reduced, facts))
    }

    /// Exposes, unless that was done already, and reads out.
    fn take(&mut self, file: &ShotFile, warn: &mut dyn FnMut(&str)) -> anyhow::Result<(Shot, RawImage)> {
        let mut file = file.clone();
        Sequence::new(&mut file)?;
        if self.compares_demosaicing {
            file.camera.color_sampling.get_or_insert(ColorSampling::Mosaic);
        }
        let mut shot = Shot::prepare_cached(&file, Inputs::default(), &mut self.scenes, warn)?;
        shot.prepare_pictures(false, warn)?;
        // Pictures: as `shoot` does where no file is an exposure.
        shot.fireflies = file.render.fireflies.unwrap_or(FireflyChoice::Reweight);
        memory::settle_fireflies(&mut shot, ExposureUse::ReadOut, self.max_memory);
        memory::check(&shot, ExposureUse::ReadOut, self.max_memory)?;
        watched("focusing", |w| shot.focus(w, warn))?;
        watched("metering", |w| shot.meter(w, warn))?;
        let key = shot.exposure_key();
        let kept = self.planes.iter().find(|p| p.0 == key).map(|p| p.1.clone());
        let plane = match kept {
            Some(plane) => plane,
            None => {
                let exposed = watched("exposing", |w| shot.expose_from(None, w, None))?;
                if exposed.stopped || watch::stopping() {
                    return Err(anyhow!("stopped: the sheet was not written"));
                }
                self.exposures += 1;
                let plane = Rc::new(shot.for_pictures(&exposed)?.unwrap_or(exposed.plane));
                self.planes.push((key, plane.clone()));
                self.forget();
                plane
            }
        };
        let raw = shot.read_out(&plane)?;
        Ok((shot, raw))
    }

    /// Drops the oldest exposures where they take too much memory.
    fn forget(&mut self) {
        let numbers = |p: &FocalPlane| p.mean.data.len() + p.half_difference.data.len() + 8 * p.width() * p.height();
        while self.planes.len() > 1 && self.planes.iter().map(|p| numbers(&p.1)).sum::<usize>() > KEPT_NUMBERS {
            self.planes.remove(0);
        }
    }
}
