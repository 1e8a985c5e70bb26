//! Ideal cameras that see as a calibration says: a camera model, or a table of rays.
//!
//! Each film point has one principal ray. With an aperture it is the middle of a round (or bladed) entrance pupil, all rays of which meet where the principal ray is in focus; without,
//! everything is sharp and the f-number only measures light. The light is even over the picture but for the vignetting that is stated: relative illumination is part of a
//! calibration, not of a projection.
//!
//! Models that divide by z focus on planes across the axis, with a pupil in the plane of the lens, as a thin lens does. All others see so far to the side that a plane means nothing:
//! they focus on spheres, and their pupil faces each direction.

use crate::camera_model::CameraModel;
use crate::thin::ThinLens;
use crate::{Blocked, BlockedBy, Focus, Iris, LensError, LensRay};
use diopter_light::units::Millimeters;
use glam::{DVec2, DVec3, Vec2};
use std::f64::consts::PI;
use std::sync::Arc;

/// How pixels of a calibration lie on the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelGrid {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Size of the film that they cover, mm.
    pub film_mm: [f64; 2],
}

impl PixelGrid {
    /// Place in pixels of a film point (mm, lens axes): the centre of the upper left pixel is (0, 0). The picture on the film is upside down and mirrored.
    pub fn pixel(&self, film_mm: DVec2) -> DVec2 {
        let [width, height] = self.size.map(|n| n as f64);
        DVec2::new((0.5 - film_mm.x / self.film_mm[0]) * width - 0.5, (0.5 + film_mm.y / self.film_mm[1]) * height - 0.5)
    }

    /// The film point of a place in pixels: [`PixelGrid::pixel`] the other way.
    pub fn film_point(&self, pixel: DVec2) -> DVec2 {
        let [width, height] = self.size.map(|n| n as f64);
        let x = (0.5 - (pixel.x + 0.5) / width) * self.film_mm[0];
        DVec2::new(x, ((pixel.y + 0.5) / height - 0.5) * self.film_mm[1])
    }
}

/// A ray for the centre of each pixel, in the camera axes of OpenCV (x right, y down, z forward).
#[derive(Clone, Debug, PartialEq)]
pub struct RayTable {
    size: [usize; 2],
    /// Origin (mm) and unit direction; a direction of 0 where nothing is seen.
    rays: Vec<[DVec3; 2]>,
}

impl RayTable {
    /// Rows from the top, columns from the left. Fails unless there is a ray for each pixel, at least two a side, all finite.
    pub fn new(size: [usize; 2], rays: Vec<[DVec3; 2]>) -> Result<RayTable, LensError> {
        let wrong = |found: String, expected: &str| LensError::Setting { what: "ray table", found, expected: expected.into() };
        let [width, height] = size;
        if width < 2 || height < 2 || width.checked_mul(height) != Some(rays.len()) {
            let found = format!("{} rays for {width} × {height} pixels", rays.len());
            return Err(wrong(found, "a ray for each pixel, and two pixels or more a side"));
        }
        if let Some(bad) = rays.iter().position(|[o, d]| !(o.is_finite() && d.is_finite())) {
            return Err(wrong(format!("no number at pixel {}, {}", bad % width, bad / width), "finite rays, 0 for no direction"));
        }
        Ok(RayTable { size, rays })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Origin (mm) and unit direction of a pixel; `None` where nothing is seen.
    pub fn at(&self, column: usize, row: usize) -> Option<[DVec3; 2]> {
        let ray = self.rays.get(row * self.size[0] + column)?;
        (ray[1] != DVec3::ZERO).then_some(*ray)
    }

    /// The ray of any place in pixels, bilinear between the pixels around it (beyond the outermost centres continued straight); `None` where one of them
    /// sees nothing.
    pub fn between(&self, pixel: DVec2) -> Option<[DVec3; 2]> {
        let cell = |at: f64, n: usize| {
            let first = at.floor().clamp(0.0, (n - 2) as f64);
            (first as usize, at - first)
        };
        if !pixel.is_finite() {
            return None;
        }
        let ((column, fx), (row, fy)) = (cell(pixel.x, self.size[0]), cell(pixel.y, self.size[1]));
        // Half a pixel beyond the centres the picture ends; a whole one is continued for low-pass filters.
        if !((-1.0..=2.0).contains(&fx) && (-1.0..=2.0).contains(&fy)) {
            return None;
        }
        let [a, b] = [self.at(column, row)?, self.at(column + 1, row)?];
        let [c, d] = [self.at(column, row + 1)?, self.at(column + 1, row + 1)?];
        let mix = |k: usize| a[k].lerp(b[k], fx).lerp(c[k].lerp(d[k], fx), fy);
        Some([mix(0), mix(1).try_normalize()?])
    }
}

/// Which way film points look.
#[derive(Clone, Debug, PartialEq)]
pub enum View {
    /// By a closed formula.
    Model(CameraModel),
    /// By a table.
    Rays(Arc<RayTable>),
}

/// An entrance pupil of an ideal camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Pupil {
    /// Its shape.
    pub iris: Iris,
    /// What is sharp.
    pub focus: Focus,
}

/// Light over the picture, of that in its middle.
#[derive(Clone, Debug, PartialEq)]
pub struct Vignetting {
    /// At equal steps of the distance from the middle of the film, from 0 to half its diagonal.
    pub falloff: Vec<f64>,
}

impl Vignetting {
    /// Fails unless it has two values or more, all from 0 to 100.
    pub fn new(falloff: Vec<f64>) -> Result<Vignetting, LensError> {
        match falloff.len() >= 2 && falloff.iter().all(|v| (0.0..=100.0).contains(v)) {
            true => Ok(Vignetting { falloff }),
            false => Err(LensError::Setting {
                what: "vignetting",
                found: format!("{} values", falloff.len()),
                expected: "two or more, from 0 to 100, 1 in the middle".into(),
            }),
        }
    }

    /// At a distance from the middle, as a fraction of half the diagonal; beyond the table its last value.
    pub fn at(&self, fraction: f64) -> f64 {
        let last = self.falloff.len() - 1;
        let place = (fraction * last as f64).clamp(0.0, last as f64);
        let i = (place as usize).min(last - 1);
        self.falloff[i] + (self.falloff[i + 1] - self.falloff[i]) * (place - i as f64)
    }
}

/// An ideal camera that sees as a calibration says.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedLens {
    /// What it is called.
    pub name: String,
    view: View,
    grid: PixelGrid,
    focal_length: Millimeters,
    f_number: f64,
    pupil: Option<Pupil>,
    vignetting: Option<Vignetting>,
}

impl CalibratedLens {
    /// `focal_length` measures light and the pupil. Fails on what a thin lens of this focal length, f-number and focus cannot be.
    pub fn new(
        name: String,
        view: View,
        grid: PixelGrid,
        focal_length: Millimeters,
        f_number: f64,
        pupil: Option<Pupil>,
        vignetting: Option<Vignetting>,
    ) -> Result<CalibratedLens, LensError> {
        let focus = pupil.as_ref().map_or(Focus::Infinity, |p| p.focus);
        ThinLens::new(focal_length, f_number, Iris::Round, focus)?;
        Ok(CalibratedLens { name, view, grid, focal_length, f_number, pupil, vignetting })
    }

    /// Which way film points look.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// How its pixels lie on the film.
    pub fn grid(&self) -> &PixelGrid {
        &self.grid
    }

    /// Focal length in the middle of the picture, mm.
    pub fn focal_length(&self) -> Millimeters {
        self.focal_length
    }

    /// f-number: focal length over diameter of the pupil; without a pupil it only says how much light arrives.
    pub fn f_number(&self) -> f64 {
        self.f_number
    }

    /// The pupil; `None` where everything is sharp.
    pub fn pupil(&self) -> Option<&Pupil> {
        self.pupil.as_ref()
    }

    /// Whether it focuses on planes across the axis instead of spheres.
    pub fn focuses_on_planes(&self) -> bool {
        matches!(&self.view, View::Model(model) if model.kind().is_perspective())
    }

    fn thin(&self) -> Option<ThinLens> {
        let pupil = self.pupil.as_ref()?;
        ThinLens::new(self.focal_length, self.f_number, Iris::Round, pupil.focus).ok()
    }

    /// Distance of what is sharp, mm; `None` for infinity (or beyond), or where everything is.
    pub fn focus_distance(&self) -> Option<Millimeters> {
        self.thin()?.focus_distance()
    }

    /// How far the film of a thin lens of this focal length would stand behind its place for infinity, mm; 0 without a pupil.
    pub fn extension(&self) -> Millimeters {
        Millimeters(self.thin().map_or(0.0, |lens| lens.film_distance().0 - lens.focal_length.0))
    }

    /// Focused elsewhere. Fails on nearer than the focal length; without a pupil it stays as it is.
    pub fn refocused(&self, focus: Focus) -> Result<CalibratedLens, LensError> {
        ThinLens::new(self.focal_length, self.f_number, Iris::Round, focus)?;
        let pupil = self.pupil.clone().map(|p| Pupil { focus, ..p });
        Ok(CalibratedLens { pupil, ..self.clone() })
    }

    /// At another f-number. Fails unless it is positive and finite.
    pub fn stopped(&self, f_number: f64) -> Result<CalibratedLens, LensError> {
        ThinLens::new(self.focal_length, f_number, Iris::Round, Focus::Infinity)?;
        Ok(CalibratedLens { f_number, ..self.clone() })
    }

    /// Radius of the pupil, mm.
    pub fn radius(&self) -> f64 {
        0.5 * self.focal_length.0 / self.f_number
    }

    /// Radius of the pupil over the distance of the film.
    pub(crate) fn pupil_reach(&self) -> f64 {
        0.5 / self.f_number * self.pupil.as_ref().map_or(1.0, |p| p.iris.reach())
    }

    /// Point and direction (lens axes) of the principal ray of a film point.
    fn principal(&self, film_mm: DVec2) -> Option<[DVec3; 2]> {
        let pixel = self.grid.pixel(film_mm);
        let [origin, direction] = match &self.view {
            View::Model(model) => [DVec3::ZERO, model.unproject(pixel)?],
            View::Rays(table) => table.between(pixel)?,
        };
        // From x right, y down, z forward to x right, y up, z backward.
        let turned = |v: DVec3| DVec3::new(v.x, -v.y, -v.z);
        Some([turned(origin), turned(direction)])
    }

    /// The ray through the middle of the pupil. `Err` where the calibration sees nothing at the film point (mm).
    pub fn chief_ray(&self, film_mm: DVec2) -> Result<LensRay, Blocked> {
        self.ray(film_mm, Vec2::ZERO)
    }

    /// The ray through the place of the pupil that belongs to `u` in the unit square. Fails as [`CalibratedLens::chief_ray`].
    pub fn ray_of(&self, film_mm: DVec2, u: [f32; 2]) -> Result<LensRay, Blocked> {
        self.ray(film_mm, self.pupil.as_ref().map_or(Vec2::ZERO, |p| p.iris.sample(u)))
    }

    /// `place`: in the pupil, in units of its radius.
    fn ray(&self, film_mm: DVec2, place: Vec2) -> Result<LensRay, Blocked> {
        let [origin, direction] = self.principal(film_mm).ok_or(Blocked { surface: 0, why: BlockedBy::Missed })?;
        let f = self.focal_length.0;
        let area = PI * self.radius().powi(2) * self.pupil.as_ref().map_or(1.0, |p| p.iris.relative_area());
        let half = 0.5 * self.grid.film_mm[0].hypot(self.grid.film_mm[1]);
        let falloff = self.vignetting.as_ref().map_or(1.0, |v| v.at(film_mm.length() / half));
        let sharp = LensRay { origin_mm: origin, direction, weight_sr: area / (f * f) * falloff };
        let Some(pupil) = self.pupil.as_ref() else { return Ok(sharp) };
        let across = place.as_dvec2() * self.radius();
        let planes = self.focuses_on_planes();
        // Axes of the pupil: those of the lens, or turned the shortest way to face the direction.
        let shift = match planes {
            true => across.extend(0.0),
            false => facing(direction, across),
        };
        let start = origin + shift;
        // Signed distance along the principal ray to what is sharp; beyond infinity it lies behind the lens.
        let distance = match pupil.focus {
            Focus::Infinity | Focus::Extension(Millimeters(0.0)) => return Ok(LensRay { origin_mm: start, ..sharp }),
            Focus::Distance(Millimeters(s)) => s,
            Focus::Extension(Millimeters(e)) => f + f * f / e,
        };
        let along = if planes { distance / -direction.z } else { distance };
        let direction = ((origin + direction * along - start) * distance.signum()).normalize();
        Ok(LensRay { origin_mm: start, direction, ..sharp })
    }
}

/// A vector (x, y) across −z, after the shortest turn of −z onto a unit direction.
fn facing(direction: DVec3, across: DVec2) -> DVec3 {
    let turn = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, direction);
    turn * across.extend(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_model::ModelKind;
    use crate::{Lens, Pinhole};

    const GRID: PixelGrid = PixelGrid { size: [360, 240], film_mm: [36.0, 24.0] };

    fn lens(kind: ModelKind, k: &[f64], pupil: Option<Focus>) -> CalibratedLens {
        // 10 pixels a mm: 20 mm.
        let model = CameraModel::new(kind, DVec2::splat(200.0), DVec2::new(179.5, 119.5), k.to_vec()).unwrap();
        let pupil = pupil.map(|focus| Pupil { iris: Iris::Round, focus });
        CalibratedLens::new("test".into(), View::Model(model), GRID, Millimeters(20.0), 2.0, pupil, None).unwrap()
    }

    #[test]
    fn without_distortion_it_sees_as_a_pinhole() {
        let hole = Lens::Pinhole(Pinhole::new(Millimeters(20.0), 8.0).unwrap());
        let model = lens(ModelKind::Pinhole, &[], None);
        for film in [DVec2::ZERO, DVec2::new(17.0, -3.0), DVec2::new(-9.0, 11.9)] {
            let (a, b) = (hole.chief_ray(film).unwrap().direction, model.chief_ray(film).unwrap().direction);
            assert!((a - b).length() < 1e-12, "{film}: {a} {b}");
        }
        let film = DVec2::new(3.7, -8.1);
        assert!((GRID.film_point(GRID.pixel(film)) - film).length() < 1e-12);
        // The upper left corner of the picture is half a pixel before the first centre.
        assert!((GRID.pixel(DVec2::new(18.0, -12.0)) - DVec2::splat(-0.5)).length() < 1e-12);
    }

    #[test]
    fn rays_of_a_film_point_meet_where_it_is_sharp() {
        let film = DVec2::new(-12.0, 7.0);
        for (kind, k) in [(ModelKind::OpenCv4, &[-0.1, 0.0, 0.0, 0.0][..]), (ModelKind::Equidistant, &[])] {
            for s in [900.0, 5000.0] {
                let lens = lens(kind, k, Some(Focus::Distance(Millimeters(s))));
                let chief = lens.chief_ray(film).unwrap();
                let along = if kind == ModelKind::OpenCv4 { s / -chief.direction.z } else { s };
                let sharp = chief.origin_mm + chief.direction * along;
                for u in [[0.1, 0.2], [0.8, 0.9], [0.3, 0.99]] {
                    let ray = lens.ray_of(film, u).unwrap();
                    assert!((ray.origin_mm - chief.origin_mm).length() > 0.1);
                    let off = (sharp - ray.origin_mm).cross(ray.direction).length();
                    assert!(off < 1e-9, "{kind:?} {s}: {off}");
                    // A distance and the extension that means it are the same.
                    let e = lens.extension();
                    let same = lens.refocused(Focus::Extension(e)).unwrap().ray_of(film, u).unwrap();
                    assert!((same.direction - ray.direction).length() < 1e-9);
                }
            }
        }
        // A pupil that faces sideways is not foreshortened.
        let wide = lens(ModelKind::Equidistant, &[], Some(Focus::Infinity));
        let ray = wide.ray_of(DVec2::new(0.0, 11.0), [0.999, 0.25]).unwrap();
        assert!(ray.origin_mm.dot(ray.direction).abs() < 1e-9);
    }

    #[test]
    fn light_is_even_but_for_what_is_stated() {
        let mut lens = lens(ModelKind::Equisolid, &[], None);
        let weight = |l: &CalibratedLens, x: f64| l.chief_ray(DVec2::new(x, 0.0)).unwrap().weight_sr;
        // π / (4 N²).
        assert!((weight(&lens, 17.0) - PI / 16.0).abs() < 1e-12);
        lens.vignetting = Some(Vignetting::new(vec![1.0, 0.5]).unwrap());
        let half = 0.5 * 36f64.hypot(24.0);
        assert!((weight(&lens, 0.5 * half) - 0.75 * PI / 16.0).abs() < 1e-12);
        assert!(Vignetting::new(vec![1.0]).is_err() && Vignetting::new(vec![1.0, f64::NAN]).is_err());
    }

    #[test]
    fn a_table_of_a_model_sees_as_the_model() {
        let model = lens(ModelKind::OpenCv4, &[-0.1, 0.01, 0.0, 0.0], None);
        let View::Model(m) = model.view() else { unreachable!() };
        let ray = |i: usize| [DVec3::ZERO, m.unproject(DVec2::new((i % 360) as f64, (i / 360) as f64)).unwrap()];
        let table = RayTable::new([360, 240], (0..360 * 240).map(ray).collect()).unwrap();
        for pixel in [DVec2::new(-0.5, -0.5), DVec2::new(359.5, 12.3), DVec2::new(100.25, 239.5), DVec2::new(77.0, 31.0)] {
            let [_, direction] = table.between(pixel).unwrap();
            // Bilinear: an eighth of the second difference of the directions, here 1e-5 (1/200 px squared) at most; a corner is continued.
            assert!((direction - m.unproject(pixel).unwrap()).length() < 3e-5, "{pixel}");
        }
        assert!(table.between(DVec2::new(-3.0, 0.0)).is_none());
        assert!(RayTable::new([2, 2], vec![[DVec3::ZERO; 2]; 3]).is_err());
        let dark = RayTable::new([2, 2], vec![[DVec3::ZERO; 2]; 4]).unwrap();
        assert!(dark.between(DVec2::splat(0.5)).is_none());
    }
}
