//! Photographs of charts: taken with a body and a lens as any shot is.

use super::predictor::Predictor;
use crate::watch::{say, warn, watched};
use anyhow::anyhow;
use diopter::image::{ExposureFacts, Picture, RawImage};
use diopter::lens::CompoundLens;
use diopter::measure::motion::Motion;
use diopter::quantity::{FNumber, LengthMm, Size};
use diopter::shot::{Shot, ShotFile};

/// With what charts are photographed.
pub(super) struct Setup<'a> {
    pub(super) body: &'a str,
    pub(super) lens: &'a str,
    pub(super) aperture: Option<FNumber>,
    pub(super) focal_length: Option<LengthMm>,
    pub(super) size: Option<Size>,
    pub(super) spp: u32,
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

/// A photograph of a chart.
pub(super) struct Photograph {
    pub(super) raw: RawImage,
    pub(super) picture: Picture,
    pub(super) shot: Shot,
    /// The same exposure read a second time.
    pub(super) second: Option<RawImage>,
    pub(super) facts: ExposureFacts,
    /// What it was taken through; none of ideal lenses.
    pub(super) lens: Option<Box<CompoundLens>>,
    pub(super) film_mm: [f64; 2],
}

impl Photograph {
    /// What the optical bench says of the lens at image heights over half of the diagonal; nothing of ideal lenses.
    pub(super) fn bench(&self, says: impl Fn(&CompoundLens, [f64; 2]) -> Vec<(f64, f64)>) -> Vec<(f64, f64)> {
        self.lens.as_deref().map_or(vec![], |lens| says(lens, self.film_mm))
    }

    /// The chain of lens and sensor, under D65.
    pub(super) fn predictor(&self) -> anyhow::Result<Predictor<'_>> {
        let lens = self.lens.as_deref().ok_or_else(|| anyhow!("expected a lens with surfaces"))?;
        Ok(Predictor {
            lens: lens.clone(),
            sensor: self.shot.sensor.clone(),
            film_mm: self.film_mm,
            size: self.raw.size(),
            diffraction: self.shot.diffracts(),
            motion: Motion::Of(&self.shot),
            light: "D65",
        })
    }
}

/// Takes a photograph of a chart as a shot file says.
pub(super) fn take(file: &ShotFile, chart: &str) -> anyhow::Result<Photograph> {
    let mut shot = Shot::prepare(file, &mut warn)?;
    watched("focusing", |w| shot.focus(w, &mut warn))?;
    watched("metering", |w| shot.meter(w, &mut warn))?;
    say(&format!("photographing {chart}"));
    let plane = watched("exposing", |w| shot.expose(w))?;
    let raw = shot.read_out(&plane)?;
    let seed = shot.reading.seed;
    shot.reading.seed = seed.wrapping_add(1);
    let second = Some(shot.read_out(&plane)?);
    shot.reading.seed = seed;
    let picture = shot.develop(&raw)?;
    let film_mm = [shot.camera.film.width_mm, shot.camera.film.height_mm];
    let lens = match &shot.camera.lens {
        diopter::lens::Lens::Compound(lens) => Some(lens.clone()),
        _ => None,
    };
    Ok(Photograph { facts: raw.header.facts.clone(), raw, second, picture, lens, film_mm, shot })
}
