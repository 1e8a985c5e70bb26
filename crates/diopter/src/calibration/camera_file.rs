//! What a file says of a camera, a model or a ray for each pixel, made into an ideal camera.

use super::{CalibrationError, CameraModel, wrong};
use crate::camera::Film;
use diopter_lens::calibrated::{CalibratedLens, PixelGrid, Pupil, RayTable, View, Vignetting};
use diopter_lens::{Focus, Iris};
use diopter_light::units::Millimeters;
use std::sync::Arc;

/// A camera as a file of text says it.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// Pixels of the calibrated pictures, where the file says them.
    pub size: Option<[usize; 2]>,
    /// Where it looks.
    pub model: CameraModel,
    /// Light over the picture; empty without.
    pub falloff: Vec<f64>,
    /// Size of the film, mm, where the file says it.
    pub film_mm: Option<[f64; 2]>,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum CameraSource {
    /// A model.
    Model(CameraFile),
    /// A ray for each pixel.
    Rays(Arc<RayTable>),
}

/// Two shapes of pictures are the same within this.
const SAME_SHAPE: f64 = 5e-3;

impl CameraSource {
    /// Columns and rows of the calibrated pictures; `None` where the file does not say them.
    pub fn size(&self) -> Option<[usize; 2]> {
        match self {
            CameraSource::Model(file) => file.size,
            CameraSource::Rays(table) => Some(table.size()),
        }
    }

    /// Focal length in the middle of the picture over the width of the picture (`width` pixels where the file does not say how many); `None` where no rays are known
    /// there.
    pub fn focal_of_width(&self, width: usize) -> Option<f64> {
        match self {
            CameraSource::Model(file) => {
                let pixels = file.size.map_or(width, |s| s[0]) as f64;
                // Of models whose scale in the middle is not their focal length, what it is.
                let [x, _] = file.model.kind().normalized(file.model.coefficients(), [1e-6, 0.0, 1.0]);
                Some(file.model.focal().x * x / 1e-6 / pixels)
            }
            CameraSource::Rays(table) => {
                let [w, h] = table.size();
                // Over some pixels: directions may be rounded to 32 bits.
                let reach = (w / 32).max(1);
                let (first, last) = (w / 2 - reach.min(w / 2), (w / 2 + reach).min(w - 1));
                let [a, b] = [table.at(first, h / 2)?, table.at(last, h / 2)?];
                let angle = a[1].cross(b[1]).length().atan2(a[1].dot(b[1]));
                (angle > 0.0).then(|| (last - first) as f64 / angle / w as f64)
            }
        }
    }

    /// The ideal camera before a film. `f_number` measures the light; with `pupil` it blurs, too. Fails where the film has another shape than the calibrated pictures.
    pub fn lens(
        &self,
        name: &str,
        film: &Film,
        f_number: f64,
        pupil: Option<(Iris, Focus)>,
    ) -> Result<CalibratedLens, CalibrationError> {
        let size = self.size().unwrap_or([film.columns, film.rows]);
        let (wanted, has) = (size[0] as f64 / size[1] as f64, film.width_mm / film.height_mm);
        if !((wanted / has - 1.0).abs() < SAME_SHAPE) {
            let found = format!("a picture of {} × {} pixels", film.columns, film.rows);
            let expected = format!("the shape of the calibrated ones, --size {}x{}", size[0], size[1]);
            return Err(wrong(name, found, expected));
        }
        let focal = self
            .focal_of_width(film.columns)
            .ok_or_else(|| wrong(name, "no rays in the middle of the picture", "a camera that sees ahead"))?;
        let grid = PixelGrid { size, film_mm: [film.width_mm, film.height_mm] };
        let told = |e: diopter_lens::LensError| wrong(name, e.to_string(), "numbers of a camera");
        let (view, falloff) = match self {
            CameraSource::Model(file) => (View::Model(file.model.clone()), &file.falloff[..]),
            CameraSource::Rays(table) => (View::Rays(table.clone()), &[][..]),
        };
        let vignetting = (!falloff.is_empty()).then(|| Vignetting::new(falloff.to_vec())).transpose().map_err(told)?;
        let pupil = pupil.map(|(iris, focus)| Pupil { iris, focus });
        CalibratedLens::new(name.to_owned(), view, grid, Millimeters(focal * film.width_mm), f_number, pupil, vignetting)
            .map_err(told)
    }
}
