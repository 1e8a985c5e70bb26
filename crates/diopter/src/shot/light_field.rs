//! A microlens array before the sensor: from a sheet or a shot file to the film.

use super::sections::PlenopticSection;
use super::{ShotError, value};
use crate::camera::{Camera, Film};
use crate::quantity::LengthMm;
use diopter_lens::microlens::MicrolensArray;
use diopter_light::lattice::Arrangement;
use diopter_sensor::Sensor;

/// Fewest pixels across a lens that can be told apart.
const FEWEST_PIXELS: f64 = 4.0;
/// Pixels across a lens that a hint suggests.
const GOOD_PIXELS: f64 = 12.0;

/// The array that a shot asks for, over what its body has. `f_number` is what its lenses match by default.
pub(super) fn array(
    asked: Option<&PlenopticSection>,
    sensor: &Sensor,
    film: &Film,
    f_number: f64,
) -> Result<Option<MicrolensArray>, ShotError> {
    if asked.is_none() && sensor.plenoptic.is_none() {
        return Ok(None);
    }
    let own = sensor.plenoptic.clone().unwrap_or_default();
    let asked = asked.cloned().unwrap_or_default();
    let length = |asked: Option<LengthMm>, own: Option<f64>| asked.map(|l| l.0).or(own);
    let Some(pitch) = length(asked.pitch, own.pitch_mm) else {
        return Err(value(
            "plenoptic",
            "a microlens array without pitch",
            "the distance of its lenses, such as pitch = \"0.1 mm\"",
        ));
    };
    let name = asked.arrangement.unwrap_or(own.arrangement);
    let arrangement = match name.as_str() {
        "" => Arrangement::default(),
        name => Arrangement::named(name).ok_or_else(|| {
            let names = Arrangement::NAMES.map(|n| n.0).join(" or ");
            value("plenoptic arrangement", format!("\"{name}\""), names)
        })?,
    };
    // Matched f-numbers: the images of the pupil touch and do not overlap (Ng 2005).
    let focal_length = length(asked.focal_length, own.focal_length_mm).unwrap_or(pitch * f_number);
    let gap = length(asked.gap, own.gap_mm).unwrap_or(focal_length);
    let array = MicrolensArray::new(arrangement, [pitch, focal_length, gap], [film.width_mm, film.height_mm])?;
    let pixels = pitch / (film.width_mm / film.columns as f64);
    if pixels < FEWEST_PIXELS * 0.999 {
        let good = |mm: f64| (mm / pitch * GOOD_PIXELS).round() as usize;
        return Err(value(
            "plenoptic pitch",
            format!("{} ({pixels:.1} pixels of the picture)", LengthMm(pitch)),
            format!(
                "at least {FEWEST_PIXELS} pixels across a lens, such as --size {}x{}, or a smaller --format",
                good(film.width_mm),
                good(film.height_mm)
            ),
        ));
    }
    Ok(Some(array))
}

/// Warns of what makes a poor light field.
pub(super) fn warn_of_pupils(camera: &Camera, warn: &mut dyn FnMut(&str)) {
    let Some(array) = camera.film.microlenses else { return };
    let across = 2.0 * array.gap * camera.lens.pupil_slope() / (camera.film.width_mm / camera.film.columns as f64);
    if across < 3.0 {
        warn(&format!(
            "the pupil's images behind the microlenses are {across:.1} pixels across: there is hardly anything to refocus"
        ));
    }
    let fraction = array.concentration(&camera.lens);
    if fraction < 0.6 {
        warn(&format!(
            "the pupil's images behind neighbouring microlenses overlap: the lens is opened wider than f/{:.1}, which they match",
            array.gap / array.lattice.pitch
        ));
    }
}
