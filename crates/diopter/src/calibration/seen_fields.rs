//! A calibrated camera as a table: which field angles its pictures show at which heights on the film, for fits of prescriptions.
//!
//! Places on the film are taken along eight directions (both axes and both diagonals), as far as the calibration sees. Heights count from the middle
//! of the film, or from the principal point, where the camera looks along its axis.

use super::camera_file::CameraSource;
use super::{CalibrationError, wrong};
use crate::camera::Film;
use diopter_lens::calibrated::CalibratedLens;
use diopter_lens::optimise::fit::{Origin, SeenField};
use glam::DVec2;

/// Places along each direction.
const STEPS: usize = 6;
/// Fewest fields that are worth a fit.
const FEWEST: usize = 8;
/// An ideal camera has an f-number that nothing here depends on.
const ANY_F_NUMBER: f64 = 8.0;

/// Fields of a calibrated camera and the size of its pixels, mm. `film_mm`: what its pixels cover, where the file does not say it. Fails where neither says it, and
/// on cameras that do not see ahead.
pub fn seen_fields(
    source: &CameraSource,
    name: &str,
    film_mm: Option<[f64; 2]>,
    origin: Origin,
) -> Result<(Vec<SeenField>, f64), CalibrationError> {
    let own = match source {
        CameraSource::Model(file) => file.film_mm,
        CameraSource::Rays(_) => None,
    };
    let [width, height] = film_mm.or(own).ok_or_else(|| {
        wrong(name, "no size of the film", "film_mm = [width, height] beside the file: what its pixels cover, mm")
    })?;
    let [columns, rows] =
        source.size().ok_or_else(|| wrong(name, "no size of the pictures", "a calibration that says its pixels"))?;
    let film = Film::new(width, height, columns, rows);
    let lens = source.lens(name, &film, ANY_F_NUMBER, None)?;
    let middle = match origin {
        Origin::FilmMiddle => DVec2::ZERO,
        Origin::PrincipalPoint => {
            principal_point(&lens).ok_or_else(|| wrong(name, "no pixel that looks along the axis", "a camera that sees ahead"))?
        }
    };
    let half = 0.5 * DVec2::new(width, height);
    let mut fields = vec![];
    for x in [-1.0, 0.0, 1.0] {
        for y in [-1.0, 0.0, 1.0] {
            let towards = DVec2::new(x, y) * half;
            // To the edge of the film from where heights count.
            let reach = [(towards.x, middle.x, half.x), (towards.y, middle.y, half.y)]
                .into_iter()
                .filter(|(step, ..)| *step != 0.0)
                .map(|(step, from, half)| (half * step.signum() - from) / step)
                .fold(f64::INFINITY, f64::min);
            if !(reach > 0.0 && reach.is_finite()) {
                continue;
            }
            fields.extend((1..=STEPS).filter_map(|k| {
                let at = middle + towards * (reach * k as f64 / STEPS as f64);
                let direction = lens.chief_ray(at).ok()?.direction;
                // Scene above the axis has its image below.
                let aside = -direction.truncate();
                let along = aside.try_normalize()?;
                Some(SeenField {
                    field_deg: aside.length().atan2(-direction.z).to_degrees(),
                    azimuth_deg: along.y.atan2(along.x).to_degrees(),
                    height_mm: (at - middle).dot(along),
                })
            }));
        }
    }
    match fields.len() >= FEWEST {
        true => Ok((fields, 0.5 * (width / columns as f64 + height / rows as f64))),
        false => Err(wrong(name, format!("{} places with a direction", fields.len()), format!("at least {FEWEST}"))),
    }
}

/// The film point that looks along the axis, mm.
fn principal_point(lens: &CalibratedLens) -> Option<DVec2> {
    let mut at = DVec2::ZERO;
    for _ in 0..50 {
        let direction = lens.chief_ray(at).ok()?.direction;
        let off = direction.truncate() / -direction.z * lens.focal_length().0;
        at += off;
        if off.length() < 1e-9 {
            return Some(at);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::camera_file::CameraFile;
    use crate::calibration::{CameraModel, ModelKind};

    fn camera(kind: ModelKind, k: Vec<f64>) -> CameraSource {
        // 0.01 mm a pixel: a focal length of 50 mm, the principal point 0.3 mm right of and 0.2 mm below the middle of the picture.
        let model = CameraModel::new(kind, DVec2::splat(5000.0), DVec2::new(1799.5 + 30.0, 1199.5 + 20.0), k).unwrap();
        CameraSource::Model(CameraFile { size: Some([3600, 2400]), model, falloff: vec![], film_mm: None })
    }

    #[test]
    fn heights_of_a_pinhole_are_f_tan_theta() {
        let (fields, pixel) =
            seen_fields(&camera(ModelKind::Pinhole, vec![]), "c", Some([36.0, 24.0]), Origin::PrincipalPoint).unwrap();
        assert!(fields.len() == 48 && (pixel - 0.01).abs() < 1e-12);
        for f in &fields {
            assert!((f.height_mm - 50.0 * f.field_deg.to_radians().tan()).abs() < 1e-6, "{f:?}");
        }
        // The picture is upside down on the film and mirrored: the principal point lies at (-0.3, +0.2) there.
        let (fields, _) = seen_fields(&camera(ModelKind::Pinhole, vec![]), "c", Some([36.0, 24.0]), Origin::FilmMiddle).unwrap();
        for f in &fields {
            let (y, x) = f.azimuth_deg.to_radians().sin_cos();
            let expected = 50.0 * f.field_deg.to_radians().tan() + DVec2::new(-0.3, 0.2).dot(DVec2::new(x, y));
            assert!((f.height_mm - expected).abs() < 1e-6, "{f:?} {expected}");
        }
    }

    #[test]
    fn fisheyes_are_f_theta_and_films_must_be_known() {
        let equidistant = camera(ModelKind::Equidistant, vec![]);
        let (fields, _) = seen_fields(&equidistant, "c", Some([36.0, 24.0]), Origin::PrincipalPoint).unwrap();
        assert!(fields.iter().all(|f| (f.height_mm - 50.0 * f.field_deg.to_radians()).abs() < 1e-6));
        let e = seen_fields(&equidistant, "c.yaml", None, Origin::PrincipalPoint).unwrap_err().to_string();
        assert!(e.contains("c.yaml") && e.contains("film_mm"), "{e}");
    }
}
