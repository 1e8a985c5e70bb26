//! ST maps, both ways: for each pixel the place in another picture from which its colour comes.
//!
//! R is the place from the left, G from the *bottom*, 0 to 1 from edge to edge, so that the centre of pixel i of n is (i + ½) / n: Nuke's STMap node, Blender's and Natron's. B is 0, A is 1 where there is
//! a place. The straight picture has the size of the camera's and the focal length that the lens has in the middle; its principal point is where the lens's axis is. *Distort*: pixels of the camera's picture, places
//! in the straight one. *Undistort*: the other way round. Both are made from traced rays, not from a model.

use super::{CalibrationError, CameraModel, wrong};
use diopter_image::{ImageError, exr};
use diopter_lens::calibrated::RayTable;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::io::{Cursor, Seek, Write};

/// Attribute that says which way a map goes, and the pinhole camera of the straight picture.
const ATTRIBUTE: &str = "diopter.st_map";
/// What is seen at more than this from the axis has no place in a straight picture: tangent of 85°.
const LARGEST_TANGENT: f64 = 11.43;

/// The straight picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Straight {
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// Principal point, pixels; the centre of the upper left pixel is (0, 0).
    pub centre: DVec2,
}

impl Straight {
    /// That of a camera: its scale and its principal point in the middle.
    pub fn of(model: &CameraModel) -> Straight {
        let [x, _] = model.kind().normalized(model.coefficients(), [1e-6, 0.0, 1.0]);
        let [_, y] = model.kind().normalized(model.coefficients(), [0.0, 1e-6, 1.0]);
        Straight { focal: model.focal() * DVec2::new(x, y) * 1e6, centre: model.centre() }
    }

    /// The pixel of a direction (axes of OpenCV); `None` at 85° from the axis and beyond.
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        let tangent = direction.truncate() / direction.z;
        (direction.z > 0.0 && tangent.length() < LARGEST_TANGENT).then(|| tangent * self.focal + self.centre)
    }

    /// The unit direction of a pixel.
    pub fn direction(&self, pixel: DVec2) -> DVec3 {
        ((pixel - self.centre) / self.focal).extend(1.0).normalize()
    }
}

/// Places in pixels for each pixel of a picture; `None` where there is none.
pub type Places = Vec<Option<DVec2>>;

/// For each pixel of the camera its place in the straight picture. `seen`: the direction of a ray from the camera's place. Order: `[row][column]`.
pub fn distort(table: &RayTable, straight: &Straight, seen: impl Fn([DVec3; 2]) -> DVec3 + Sync) -> Places {
    let [width, height] = table.size();
    (0..width * height).into_par_iter().map(|i| straight.pixel(seen(table.at(i % width, i / width)?))).collect()
}

/// For each pixel of the straight picture its place in the camera's: the rays between pixels are searched by Newton's method, from where the model puts them.
/// Order: `[row][column]`; `None` where the search comes no nearer than a thousandth of a pixel.
pub fn undistort(
    table: &RayTable,
    straight: &Straight,
    model: &CameraModel,
    seen: impl Fn([DVec3; 2]) -> DVec3 + Sync,
) -> Places {
    let [width, height] = table.size();
    let find = |wanted: DVec2| {
        let direction = straight.direction(wanted);
        let there = |at: DVec2| straight.pixel(seen(table.between(at)?));
        let mut at = model.project(direction).or_else(|| straight.pixel(direction))?;
        at = at.clamp(DVec2::ZERO, DVec2::new((width - 1) as f64, (height - 1) as f64));
        let mut off = there(at)? - wanted;
        for _ in 0..40 {
            if off.length() < 1e-6 {
                break;
            }
            // Within a cell the table is nearly straight: differences over a quarter of a pixel, away from its edges.
            let h = 0.25;
            let by = |step: DVec2| Some((there(at + step)? - there(at - step)?) / (2.0 * h));
            let (dx, dy) = (by(DVec2::X * h)?, by(DVec2::Y * h)?);
            let determinant = dx.x * dy.y - dx.y * dy.x;
            let step = DVec2::new(dy.y * off.x - dy.x * off.y, dx.x * off.y - dx.y * off.x) / determinant;
            if !step.is_finite() {
                return None;
            }
            // Halved until it comes nearer.
            let mut fraction = 1.0;
            loop {
                let next = at - step * fraction;
                match there(next).map(|p| p - wanted) {
                    Some(new) if new.length() < off.length() => {
                        (at, off) = (next, new);
                        break;
                    }
                    _ if fraction < 1e-3 => return (off.length() < 1e-3).then_some(at),
                    _ => fraction *= 0.5,
                }
            }
        }
        (off.length() < 1e-3).then_some(at)
    };
    (0..width * height).into_par_iter().map(|i| find(DVec2::new((i % width) as f64, (i / width) as f64))).collect()
}

/// Writes a map. Fails where `to` cannot be written.
pub fn write(
    places: &Places,
    [width, height]: [usize; 2],
    straight: &Straight,
    distorts: MapDirection,
    to: impl Write + Seek,
) -> Result<(), ImageError> {
    let fraction = |p: DVec2| [(p.x + 0.5) / width as f64, 1.0 - (p.y + 0.5) / height as f64];
    let plane = |k: usize| places.iter().map(|p| p.map_or(-1.0, |p| fraction(p)[k] as f32)).collect::<Vec<f32>>();
    let alpha = places.iter().map(|p| if p.is_some() { 1.0 } else { 0.0 }).collect();
    let (f, m) = (straight.focal, straight.centre);
    let way = if distorts == MapDirection::Distort { "distort" } else { "undistort" };
    let text = serde_json::json!({ "way": way, "fx": f.x, "fy": f.y, "cx": m.x, "cy": m.y }).to_string();
    let planes = vec![("R", plane(0)), ("G", plane(1)), ("B", vec![0.0; width * height]), ("A", alpha)];
    exr::write_maps([width, height], planes, &[(ATTRIBUTE, &text)], to)
}

/// Which way a map goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MapDirection {
    /// From the straight picture to the camera's.
    Distort,
    /// From the camera's picture to the straight one.
    Undistort,
}

/// Reads a map that distorts as the rays of a camera. `focal_of_width`: focal length of the straight picture over its width, where the file
/// does not say it.
pub(super) fn read(bytes: &[u8], name: &str, focal_of_width: Option<f64>) -> Result<RayTable, CalibrationError> {
    let maps = exr::read_maps(Cursor::new(bytes), &["R", "G"])
        .map_err(|e| wrong(name, e.to_string(), "an ST map with R and G, or a ray table"))?;
    let [width, height] = maps.size;
    let told: Option<serde_json::Value> = maps.attribute(ATTRIBUTE).and_then(|t| serde_json::from_str(t).ok());
    let number = |key: &str| told.as_ref()?.get(key)?.as_f64();
    if told.as_ref().and_then(|t| t.get("way")?.as_str()) == Some("undistort") {
        return Err(wrong(name, "a map that undistorts", "the one that distorts: it says where each pixel of the camera looks"));
    }
    let straight = match (number("fx"), number("fy"), number("cx"), number("cy"), focal_of_width) {
        (Some(fx), Some(fy), Some(cx), Some(cy), _) => Straight { focal: DVec2::new(fx, fy), centre: DVec2::new(cx, cy) },
        (.., Some(f)) => {
            Straight { focal: DVec2::splat(f * width as f64), centre: DVec2::new(width as f64, height as f64) * 0.5 - 0.5 }
        }
        _ => {
            return Err(wrong(
                name,
                "an ST map that does not say its focal length",
                "--focal-length or --fov of its straight picture beside it",
            ));
        }
    };
    if !(straight.focal.is_finite() && straight.focal.min_element() > 0.0 && straight.centre.is_finite()) {
        return Err(wrong(name, format!("focal lengths of {} pixels", straight.focal), "positive numbers"));
    }
    let ray = |i: usize| {
        let [s, t] = [0, 1].map(|k| f64::from(maps.planes[k][i]));
        let nothing = !(s.is_finite() && t.is_finite()) || (s == -1.0 && t == -1.0);
        let at = DVec2::new(s * width as f64 - 0.5, (1.0 - t) * height as f64 - 0.5);
        [DVec3::ZERO, if nothing { DVec3::ZERO } else { straight.direction(at) }]
    };
    RayTable::new(maps.size, (0..width * height).map(ray).collect())
        .map_err(|e| wrong(name, e.to_string(), "a place for each pixel"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::ModelKind;

    /// A wide camera with barrel distortion, as a table.
    fn camera() -> (RayTable, CameraModel) {
        let model = CameraModel::new(
            ModelKind::OpenCv5,
            DVec2::new(150.0, 150.0),
            DVec2::new(119.5, 79.5),
            vec![-0.12, 0.02, 0.0005, -0.0003, 0.0],
        )
        .unwrap();
        let ray = |i: usize| [DVec3::ZERO, model.unproject(DVec2::new((i % 240) as f64, (i / 240) as f64)).unwrap()];
        (RayTable::new([240, 160], (0..240 * 160).map(ray).collect()).unwrap(), model)
    }

    #[test]
    fn forward_and_back_is_the_same_place() {
        let (table, model) = camera();
        let straight = Straight::of(&model);
        assert!((straight.focal - DVec2::splat(150.0)).length() < 1e-6);
        let there = distort(&table, &straight, |r| r[1]);
        let back = undistort(&table, &straight, &model, |r| r[1]);
        let at = |places: &Places, p: DVec2| {
            let (x, y) = (p.x.floor(), p.y.floor());
            let inside = x >= 0.0 && y >= 0.0 && x < 239.0 && y < 159.0;
            let get = |dx: usize, dy: usize| places[(y as usize + dy) * 240 + x as usize + dx];
            if !inside {
                return None;
            }
            let [a, b, c, d] = [get(0, 0)?, get(1, 0)?, get(0, 1)?, get(1, 1)?];
            Some(a.lerp(b, p.x - x).lerp(c.lerp(d, p.x - x), p.y - y))
        };
        let (mut worst, mut count) = (0.0f64, 0);
        for (i, place) in back.iter().enumerate() {
            let own = DVec2::new((i % 240) as f64, (i / 240) as f64);
            if let Some(again) = place.and_then(|p| at(&there, p)) {
                worst = worst.max((again - own).length());
                count += 1;
            }
        }
        assert!(worst < 0.02 && count > 30_000, "{worst} {count}");
    }

    #[test]
    fn a_map_is_read_as_the_camera_that_it_is() {
        let (table, model) = camera();
        let straight = Straight::of(&model);
        let places = distort(&table, &straight, |r| r[1]);
        let mut file = Cursor::new(Vec::new());
        write(&places, [240, 160], &straight, MapDirection::Distort, &mut file).unwrap();
        let read_back = read(file.get_ref(), "map.exr", None).unwrap();
        for (column, row) in [(0, 0), (239, 159), (100, 30)] {
            let (a, b) = (table.at(column, row).unwrap()[1], read_back.at(column, row).unwrap()[1]);
            // 32 bits of a fraction: 1e-7 of 240 pixels over 150.
            assert!((a - b).length() < 1e-6, "{column} {row}");
        }
        let mut other = Cursor::new(Vec::new());
        write(&places, [240, 160], &straight, MapDirection::Undistort, &mut other).unwrap();
        assert!(read(other.get_ref(), "map.exr", None).unwrap_err().to_string().contains("undistorts"));
        // Nuke's numbers: the centre of the lower left pixel is (½ / w, ½ / h).
        let maps = exr::read_maps(Cursor::new(file.get_ref()), &["R", "G"]).unwrap();
        let middle = 80 * 240 + 120;
        assert!((maps.planes[0][middle] - 120.5 / 240.0).abs() < 1e-4 && (maps.planes[1][middle] - 79.5 / 160.0).abs() < 1e-4);
    }
}
