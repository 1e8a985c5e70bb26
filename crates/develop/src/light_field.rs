//! Light fields: the raw picture behind a microlens array, decoded.
//!
//! A pixel of such a picture is one sample of the light field: it belongs to the lens whose image of the pupil it lies in, and its place in
//! that image is the place q of the pupil that it sees the scene through. All pictures are sums of these samples, each channel for itself, so
//! nothing is demosaiced. With the film moved by Δ the sample of the lens at c falls to c − q σ, σ = Δ / (1 + Δ κ) (scaled back to the framing of the
//! shot; κ is one over the distance of the exit pupil).
//!
//! Sources: R. Ng et al. 2005, "Light field photography with a hand-held plenoptic camera" (refocusing by shearing); Z. Yu, J. Yu, A.
//! Lumsdaine & T. Georgiev 2012, "An analysis of color demosaicing in plenoptic cameras" (colours filled in by refocusing); M. Tao et al.
//! 2013, "Depth from combining defocus and correspondence using light-field cameras" (the spread of the views as a measure of depth); D.
//! Dansereau et al. 2013, "Decoding, calibration and rectification for lenselet-based plenoptic cameras" (the geometry).

mod decode;
mod pupils;
pub(crate) mod settings;

pub use self::decode::{Decoder, DepthMap};

use self::pupils::Pupils;
use self::settings::LightField as Settings;
use crate::setting::RecipeError;
use diopter_image::{ExposureFacts, LightFieldFacts, RawHeader};
use diopter_light::lattice::{Arrangement, Lattice};
use glam::DVec2;
/// What is to be made of a light field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focus {
    /// What was sharp when it was taken.
    AsTaken,
    /// A distance from the lens, m; may be infinite.
    At(f64),
    /// All of it.
    Everything,
}

impl Focus {
    /// Reads `as-taken`, `all`, `inf` or a distance such as `1.2 m`.
    pub fn parse(text: &str) -> Option<Focus> {
        let text = text.trim().to_lowercase();
        let length = |t: &str| {
            let (number, unit) = match t.strip_suffix("mm").map(|n| (n, 1e-3)).or(t.strip_suffix("cm").map(|n| (n, 1e-2))) {
                Some(found) => found,
                None => (t.strip_suffix('m').unwrap_or(t), 1.0),
            };
            let metres = number.trim().parse::<f64>().ok()? * unit;
            (metres > 0.0 && metres.is_finite()).then_some(Focus::At(metres))
        };
        match text.as_str() {
            "as-taken" => Some(Focus::AsTaken),
            "all" => Some(Focus::Everything),
            "inf" | "infinity" => Some(Focus::At(f64::INFINITY)),
            other => length(other),
        }
    }
}

/// The geometry of a raw light field.
#[derive(Clone, Debug)]
pub struct LightField {
    facts: LightFieldFacts,
    /// Shapes of the pupil over the film; a disk everywhere without.
    pupils: Option<Pupils>,
    /// Lenses, mm on the film.
    lattice: Lattice,
    magnification: f64,
    /// Pixels of the mosaic.
    mosaic: [usize; 2],
    /// Pixels of a picture made of it, and their size, mm.
    size: [usize; 2],
    step_mm: f64,
    /// Radius of the pupil's image, pixels of the mosaic.
    radius_px: f64,
    focal_length_mm: f64,
    extension_mm: f64,
}

fn wrong(place: &str, found: impl ToString, expected: impl Into<String>) -> RecipeError {
    RecipeError { place: place.into(), found: found.to_string(), expected: expected.into() }
}

impl LightField {
    /// The light field of a raw file; `None` where no microlenses are known. Fails when what is told of them makes no sense.
    pub fn of(header: &RawHeader, mosaic: [usize; 2]) -> Result<Option<LightField>, RecipeError> {
        let Some(facts) = header.facts.light_field.clone() else { return Ok(None) };
        let bad =
            |what: &str| Err(wrong("light field", format!("a file whose {what}"), "the facts that a plenoptic camera writes"));
        let Some(arrangement) = Arrangement::named(&facts.arrangement) else {
            return bad("microlenses stand in no known way");
        };
        let positive = [facts.pitch_mm, facts.gap_mm, facts.pupil_slope, facts.pixel_mm[0], facts.pixel_mm[1]];
        let finite = [facts.origin_mm[0], facts.origin_mm[1], facts.exit_curvature_per_mm, facts.object_offset_mm];
        if !positive.iter().all(|v| *v > 0.0 && v.is_finite()) || !finite.iter().all(|v| v.is_finite()) {
            return bad("microlenses have impossible sizes");
        }
        let lattice = Lattice { arrangement, pitch: facts.pitch_mm, origin: DVec2::from_array(facts.origin_mm) };
        let step_mm = lattice.cell_area().sqrt();
        let pixels = |k: usize| (mosaic[k] as f64 * facts.pixel_mm[k] / step_mm * (1.0 + 1e-9)) as usize;
        let size = [pixels(0), pixels(1)];
        let magnification = 1.0 + facts.gap_mm * facts.exit_curvature_per_mm;
        if size.iter().any(|n| *n < 2) || size[0] > mosaic[0] || size[1] > mosaic[1] || magnification <= 0.0 {
            return bad("microlenses do not fit its pixels");
        }
        let film_mm = DVec2::from_array([0, 1].map(|k| mosaic[k] as f64 * facts.pixel_mm[k]));
        let pupils = facts.pupils.as_ref().map(|shapes| Pupils::new(shapes, film_mm));
        if let Some(None) = pupils {
            return bad("shapes of the pupil make no sense");
        }
        Ok(Some(LightField {
            pupils: pupils.flatten(),
            radius_px: facts.gap_mm * facts.pupil_slope / facts.pixel_mm[0],
            facts,
            lattice,
            magnification,
            mosaic,
            size,
            step_mm,
            focal_length_mm: header.facts.focal_length_mm,
            extension_mm: header.facts.extension_mm,
        }))
    }

    /// Columns and rows of the pictures that are made of it.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Diagonal of the mosaic over that of the pictures, both on the film.
    pub fn film_over_picture(&self) -> f64 {
        let [w, h] = [0, 1].map(|k| self.mosaic[k] as f64 * self.facts.pixel_mm[k]);
        w.hypot(h) / ((self.size[0] as f64).hypot(self.size[1] as f64) * self.step_mm)
    }

    /// Views across the pupil that can be told apart.
    pub fn views_across(&self) -> usize {
        (self.radius_px as usize).clamp(1, 32)
    }

    /// About how many periods of the filters a pixel of a picture is the mean of.
    pub(crate) fn samples_a_pixel(&self, settings: &Settings, f_number: f64) -> f64 {
        let radius = match (settings.view, settings.aperture) {
            (Some(_), _) => 1.0,
            (None, Some(n)) => self.radius_px * f_number / n,
            (None, None) => self.radius_px,
        };
        std::f64::consts::PI * radius * radius / 4.0
    }

    /// Checks the settings with what the file says; `f_number`: that of the shot.
    pub(crate) fn check(&self, settings: &Settings, f_number: f64) -> Result<(), RecipeError> {
        check(settings)?;
        if let Some(Focus::At(distance)) = Focus::parse(&settings.focus) {
            self.shift_for(distance)?;
        }
        match settings.aperture {
            Some(n) if n < f_number * 0.999 => {
                let expected = format!("f/{f_number:.2}, at which it was taken, or more");
                Err(wrong("light_field.aperture", format!("f/{n}"), expected))
            }
            Some(n) if n > self.smallest_aperture(f_number) * 1.001 => {
                let smallest = self.smallest_aperture(f_number);
                let expected = format!("f/{f_number:.2} to f/{smallest:.2}: so many pixels lie across the pupil");
                Err(wrong("light_field.aperture", format!("f/{n}"), expected))
            }
            _ => Ok(()),
        }
    }

    /// f-number of a part of the pupil that has a radius of one pixel: smaller ones are not told apart.
    fn smallest_aperture(&self, f_number: f64) -> f64 {
        f_number * self.radius_px.max(1.0)
    }

    /// Extension at which a distance (m) is sharp, mm.
    fn extension_at(&self, distance_m: f64) -> f64 {
        match distance_m.is_infinite() {
            true => 0.0,
            false => self.focal_length_mm.powi(2) / (1e3 * distance_m + self.facts.object_offset_mm),
        }
    }

    /// Shift (pixels of a picture) of light through the pupil's edge for a film at an extension.
    fn shift_at(&self, extension_mm: f64) -> f64 {
        let moved = extension_mm - self.extension_mm;
        moved / (1.0 + moved * self.facts.exit_curvature_per_mm) * self.facts.pupil_slope / self.step_mm
    }

    /// Distance (m) that is sharp with a shift: [`LightField::shift_at`] turned around.
    fn distance_at(&self, shift: f64) -> f64 {
        let sheared = shift * self.step_mm / self.facts.pupil_slope;
        let extension = self.extension_mm + sheared / (1.0 - sheared * self.facts.exit_curvature_per_mm);
        match extension > 1e-9 {
            true => 1e-3 * (self.focal_length_mm.powi(2) / extension - self.facts.object_offset_mm),
            false => f64::INFINITY,
        }
    }

    /// Shift for a distance. Fails on distances that no film brings into focus.
    fn shift_for(&self, distance_m: f64) -> Result<f64, RecipeError> {
        let nearest_mm = 1.05 * self.focal_length_mm - self.facts.object_offset_mm;
        if 1e3 * distance_m < nearest_mm {
            let expected = format!("a distance of at least {:.3} m: nearer there is no image", 1e-3 * nearest_mm);
            return Err(wrong("light_field.focus", format!("{distance_m} m"), expected));
        }
        Ok(self.shift_at(self.extension_at(distance_m)))
    }

    /// What the facts of a picture made of it are.
    pub(crate) fn facts_of(&self, facts: &ExposureFacts, settings: &Settings) -> ExposureFacts {
        let mut facts = ExposureFacts { light_field: None, ..facts.clone() };
        if let Some(Focus::At(distance)) = Focus::parse(&settings.focus) {
            facts.focus_distance_m = distance.is_finite().then_some(distance);
            facts.extension_mm = self.extension_at(distance);
            facts.focus_mode = "refocused".into();
        }
        if let Some(n) = settings.aperture {
            facts.t_number *= n / facts.f_number;
            facts.f_number = n;
        }
        facts
    }
}

/// Checks the settings as far as that goes without a file.
pub(crate) fn check(settings: &Settings) -> Result<(), RecipeError> {
    if !settings.focus.is_empty() && Focus::parse(&settings.focus).is_none() {
        let expected = "as-taken, all, inf or a distance such as \"1.2 m\"";
        return Err(wrong("light_field.focus", format!("\"{}\"", settings.focus), expected));
    }
    match settings.view {
        Some([x, y]) if x.hypot(y) > 1.0 => {
            Err(wrong("light_field.view", format!("{x}, {y}"), "a place in the pupil: at most 1 from its middle"))
        }
        Some(_) if settings.aperture.is_some() => {
            Err(wrong("light_field.view", "an aperture beside it", "one of the two: a view is through one place of the pupil"))
        }
        _ => Ok(()),
    }
}
