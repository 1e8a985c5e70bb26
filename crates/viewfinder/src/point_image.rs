//! The image of a point at a place of the picture: contrast over spatial frequency (MTF) and where rays land (spot diagram), by the optical bench of the lens.
//!
//! Real lenses are traced as `diopter lens mtf` and `lens spot` trace them, as they stand: focus, aperture and zoom of the latest frame. An ideal lens has a
//! closed form, the perfect round pupil out of focus. Light goes from the scene to the film. Lengths on the film in µm, frequencies in cycles/mm; sagittal is
//! detail across the direction to the middle of the picture's axis, tangential along it.

use crate::pointer::{depth_m, field_deg, film_point};
use crate::session::Live;
use diopter::lens::analysis::{Bench, Spot, VISUAL_NM, airy_mtf, defocused_airy_mtf};
use diopter::lens::compound::CompoundLens;
use diopter::lens::{Lens, ThinLens};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Spatial frequencies of the table, cycles/mm: 10 and 30 are those of makers' data sheets.
const FREQUENCIES: [f64; 4] = [10.0, 20.0, 30.0, 50.0];
/// Rays across the pupil of a spot diagram.
const SPOT_RAYS: usize = 24;
/// Answers that are kept: of a lens that a dial turns to and fro.
const KEPT: usize = 16;
/// Radius of the first dark ring of an Airy pattern over λN. Source: Born & Wolf, *Principles of Optics*, §8.5.2.
const AIRY_RADIUS: f64 = 1.219_67;

/// Where the point is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Of {
    /// In the plane that is in focus.
    #[default]
    Focus,
    /// At the distance of what the picture shows there.
    Subject,
}

/// Why there is no image of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Missing {
    /// No light comes through the lens there.
    Dark,
    /// A pinhole: the f-number only measures its light.
    Pinhole,
    /// A calibrated camera, of which only the directions are known.
    Calibrated,
    /// A tilted ideal lens: its plane of focus is no plane across the axis.
    Tilted,
    /// Nearer than the lens forms images.
    TooNear,
}

/// Contrast at one frequency, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Contrast {
    /// Cycles/mm.
    pub frequency: f64,
    /// Of detail across the radial direction.
    pub sagittal: f64,
    /// Of detail along it.
    pub tangential: f64,
    /// Of a perfect lens of the same f-number, on the axis.
    pub limit: f64,
}

/// Rays of one wavelength.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpotRays {
    /// nm.
    pub nm: f64,
    /// Root mean square distance from their own mean, µm.
    pub rms_um: f64,
    /// Places from the mean of the reference wavelength, µm: sagittal, tangential (outwards).
    pub points_um: Vec<[f64; 2]>,
}

/// The image of a point.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PointImage {
    /// Angle of the chief ray to the axis, degrees; `None` where the lens shows nothing.
    pub field_deg: Option<f64>,
    /// Distance of the point along the axis, m; `None`: infinity.
    pub object_m: Option<f64>,
    /// Why there is nothing more.
    pub missing: Option<Missing>,
    /// Over the frequencies.
    pub mtf: Vec<Contrast>,
    /// By rays alone: the wavefront is too steep for diffraction to matter.
    pub geometric: bool,
    /// The lens is another one in other directions, and the bench looks along the vertical.
    pub along_vertical: bool,
    /// Spot diagram by wavelengths; empty of ideal lenses.
    pub spot: Vec<SpotRays>,
    /// Diameter of the blur disk of an ideal lens, µm.
    pub disk_um: Option<f64>,
    /// Radius of the first dark ring of a perfect lens's image, µm: 1.22 λ N on the axis, at the reference wavelength.
    pub airy_um: f64,
}

/// Answers of late, the newest last. Only one is computed at a time: who waits longer than its page points there is not better served by two.
#[derive(Default)]
pub struct PointImages {
    known: Mutex<VecDeque<(Key, PointImage)>>,
}

/// What an image of a point depends on.
#[derive(Clone, PartialEq)]
struct Key {
    lens: Lens,
    film_mm: [f64; 2],
    object_m: Option<f64>,
}

impl PointImages {
    /// The image of a point at a place of the latest frame, 0 to 1 across and down. Takes up to a second.
    pub fn at(&self, live: &Live, place: [f64; 2], of: Of) -> PointImage {
        let film = film_point(live, place);
        let object_m = match of {
            Of::Focus => live.lens.focus_distance().map(|mm| mm.0 / 1000.0),
            Of::Subject => depth_m(live, place),
        };
        let key = Key { lens: live.lens.clone(), film_mm: film.to_array(), object_m };
        // What a thread that panicked left behind is whole answers.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, image)) = known.iter().find(|(k, _)| *k == key) {
            return image.clone();
        }
        let image = image(&live.lens, field_deg(live, film), object_m);
        if known.len() >= KEPT {
            known.pop_front();
        }
        known.push_back((key, image.clone()));
        image
    }
}

/// The image of a point at a field angle (degrees) and a distance along the axis from the lens (m; `None`: infinity).
fn image(lens: &Lens, field_deg: Option<f64>, object_m: Option<f64>) -> PointImage {
    let nothing = |missing| PointImage { field_deg, object_m, missing: Some(missing), ..Default::default() };
    let Some(field) = field_deg else { return nothing(Missing::Dark) };
    let found = match lens {
        Lens::Compound(lens) => traced(lens, field, object_m).ok_or(Missing::Dark),
        Lens::Thin(lens) => ideal(lens, field, object_m),
        Lens::Pinhole(_) => Err(Missing::Pinhole),
        Lens::Calibrated(_) => Err(Missing::Calibrated),
    };
    match found {
        Ok(image) => PointImage { field_deg, object_m, ..image },
        Err(missing) => nothing(missing),
    }
}

/// By rays through a real lens; `None` where none comes through.
fn traced(lens: &CompoundLens, field_deg: f64, object_m: Option<f64>) -> Option<PointImage> {
    let usage = &lens.prescription().usage;
    let (wavelengths, reference) = match usage.wavelengths_nm.get(usage.reference) {
        Some(reference) => (usage.wavelengths_nm.clone(), *reference),
        None => (VISUAL_NM.to_vec(), VISUAL_NM[1]),
    };
    // Distances of the camera count from the entrance pupil, those of the bench from the first vertex.
    let object_distance = object_m.map(|m| 1000.0 * m - lens.first_order().entrance_pupil_z);
    let bench = Bench { system: lens.system(), object_distance };
    let colors: Vec<(f64, f64)> = wavelengths.iter().map(|nm| (*nm, 1.0)).collect();
    let mtf = bench.diffraction_mtf(field_deg, &colors, &FREQUENCIES, 0.0)?;
    let working = working_f_number(lens.pupil_slope());
    let contrast = |(i, f): (usize, &f64)| Contrast {
        frequency: *f,
        sagittal: mtf.sagittal[i],
        tangential: mtf.tangential[i],
        limit: airy_mtf(*f, reference, working),
    };
    let spots: Vec<Spot> = wavelengths.iter().filter_map(|nm| bench.spot(field_deg, *nm, reference, SPOT_RAYS, 0.0)).collect();
    let middle = spots.iter().find(|s| s.nm == reference).or(spots.first())?.centroid;
    // Hundredths of a µm are a fiftieth of a wavelength.
    let um = |mm: f64| (1e5 * mm).round() / 100.0;
    let spot_rays = |s: &Spot| SpotRays {
        nm: s.nm,
        rms_um: 1000.0 * s.rms,
        points_um: s.points.iter().map(|p| (*p - middle).to_array().map(um)).collect(),
    };
    Some(PointImage {
        mtf: FREQUENCIES.iter().enumerate().map(contrast).collect(),
        geometric: mtf.geometric,
        along_vertical: !lens.system().is_rotational(),
        spot: spots.iter().map(spot_rays).collect(),
        airy_um: airy_um(reference, working),
        ..Default::default()
    })
}

/// The closed form of an ideal lens: a perfect round pupil, out of focus by what the film is beside the image.
///
/// From a place at an angle θ the pupil is seen smaller by cos θ across the radial direction and by cos³ θ along it, which moves the cut-off
/// frequencies; the blur is the same disk everywhere, since pupil and film are parallel.
fn ideal(lens: &ThinLens, field_deg: f64, object_m: Option<f64>) -> Result<PointImage, Missing> {
    if lens.is_tilted() {
        return Err(Missing::Tilted);
    }
    let reference = VISUAL_NM[1];
    let (f, film) = (lens.focal_length.0, lens.film_distance().0);
    let of_image = match object_m {
        None => 1.0 / f,
        Some(m) => 1.0 / f - 1.0 / (1000.0 * m),
    };
    if !(of_image > 0.0 && of_image.is_finite()) {
        return Err(Missing::TooNear);
    }
    let blur_mm = 2.0 * lens.radius() * (1.0 - film * of_image).abs();
    let working = working_f_number(lens.radius() / film);
    let cutoff = 1.0 / (reference * 1e-6 * working);
    let cos = field_deg.to_radians().cos();
    let contrast = |f: &f64| Contrast {
        frequency: *f,
        sagittal: defocused_airy_mtf(*f, cutoff * cos, blur_mm).abs(),
        tangential: defocused_airy_mtf(*f, cutoff * cos.powi(3), blur_mm).abs(),
        limit: airy_mtf(*f, reference, working),
    };
    let mtf = FREQUENCIES.iter().map(contrast).collect();
    Ok(PointImage { mtf, disk_um: Some(1000.0 * blur_mm), airy_um: airy_um(reference, working), ..Default::default() })
}

/// Distance of the exit pupil over its diameter, by its radius over distance.
fn working_f_number(slope: f64) -> f64 {
    0.5 / slope.max(1e-9)
}

fn airy_um(nm: f64, f_number: f64) -> f64 {
    1e-3 * AIRY_RADIUS * nm * f_number
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::lens::compound::Setting;
    use diopter::lens::{Focus, Iris, Pinhole};
    use diopter::light::units::Millimeters;
    use std::sync::Arc;

    fn thin(f_number: f64, focus: Focus) -> Lens {
        Lens::Thin(ThinLens::new(Millimeters(50.0), f_number, Iris::Round, focus).unwrap())
    }

    fn real(name: &str, f_number: f64, focus: Focus) -> Lens {
        let setting = Setting { focal_length: None, f_number: Some(f_number), focus, iris: None, film_mm: [36.0, 24.0] };
        Lens::Compound(Box::new(CompoundLens::new(Arc::new(diopter::lens::embedded(name).unwrap()), &setting).unwrap()))
    }

    #[test]
    fn an_ideal_lens_is_diffraction_limited_in_focus_and_a_disk_out_of_it() {
        let lens = thin(8.0, Focus::Distance(Millimeters(2000.0)));
        let sharp = image(&lens, Some(0.0), Some(2.0));
        assert!(sharp.disk_um.unwrap() < 1e-6 && sharp.missing.is_none() && sharp.spot.is_empty());
        for c in &sharp.mtf {
            assert!((c.sagittal - c.limit).abs() < 1e-4 && (c.tangential - c.limit).abs() < 1e-4, "{c:?}");
        }
        // f/8 drawn out for 2 m: 1.22 · 0.5876 µm · 8.2.
        assert!((sharp.airy_um - 1.21967 * 0.587_561_8 * 8.0 * (2000.0 / 1950.0)).abs() < 1e-3, "{}", sharp.airy_um);
        // Infinity, the lens focused at 2 m: the blur of the depth-of-field tables.
        let far = image(&lens, Some(0.0), None);
        let blur = 1000.0 * diopter::depth_of_field::circle_mm(50.0, 8.0, 2.0, f64::INFINITY);
        assert!((far.disk_um.unwrap() / blur - 1.0).abs() < 1e-9, "{far:?} {blur}");
        assert!(far.mtf[2].tangential < 0.1 && far.object_m.is_none());
        // Aside, the pupil is foreshortened along the radius.
        let aside = image(&lens, Some(20.0), Some(2.0));
        assert!(aside.mtf[3].tangential < aside.mtf[3].sagittal && aside.mtf[3].sagittal < sharp.mtf[3].sagittal);
        assert_eq!(image(&lens, Some(0.0), Some(0.04)).missing, Some(Missing::TooNear));
    }

    #[test]
    fn a_real_lens_is_what_the_bench_says() {
        let lens = real("double-gauss-50mm", 4.0, Focus::Infinity);
        let found = image(&lens, Some(12.0), None);
        let Lens::Compound(compound) = &lens else { unreachable!() };
        let bench = Bench::at_infinity(compound.system());
        let colors = VISUAL_NM.map(|nm| (nm, 1.0));
        let mtf = bench.diffraction_mtf(12.0, &colors, &FREQUENCIES, 0.0).unwrap();
        for (i, c) in found.mtf.iter().enumerate() {
            assert_eq!((c.sagittal, c.tangential), (mtf.sagittal[i], mtf.tangential[i]));
            assert!(c.sagittal <= c.limit + 0.02 && c.limit < 1.0, "{c:?}");
        }
        assert_eq!(found.spot.len(), 3);
        let d = found.spot.iter().find(|s| s.nm == VISUAL_NM[1]).unwrap();
        let mean = d.points_um.iter().fold([0.0; 2], |m, p| [m[0] + p[0], m[1] + p[1]]).map(|v| v / d.points_um.len() as f64);
        assert!(mean[0].abs() < 0.01 && mean[1].abs() < 0.01 && d.rms_um > 0.0, "{mean:?}");
        // f/4: 1.22 λ N to the accuracy of the paraxial pupil.
        assert!((found.airy_um / (1.21967 * 0.587_561_8 * 4.0) - 1.0).abs() < 0.02, "{}", found.airy_um);
        assert!(!found.along_vertical && !found.geometric);
        // What is out of focus has no contrast left.
        let near = image(&lens, Some(0.0), Some(1.0));
        assert!(near.mtf[3].sagittal < 0.2 && near.object_m == Some(1.0), "{near:?}");
    }

    #[test]
    fn what_has_no_image_of_a_point_says_why() {
        let hole = Lens::Pinhole(Pinhole::new(Millimeters(50.0), 100.0).unwrap());
        assert_eq!(image(&hole, Some(3.0), None).missing, Some(Missing::Pinhole));
        assert_eq!(image(&hole, None, None).missing, Some(Missing::Dark));
        let Lens::Thin(lens) = thin(8.0, Focus::Infinity) else { unreachable!() };
        assert_eq!(image(&Lens::Thin(lens.tilted([0.1, 0.0]).unwrap()), Some(0.0), None).missing, Some(Missing::Tilted));
        // Far outside of what it shows.
        let real = real("double-gauss-50mm", 4.0, Focus::Infinity);
        assert_eq!(image(&real, Some(85.0), None).missing, Some(Missing::Dark));
    }
}
