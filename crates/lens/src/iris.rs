//! The shape of the aperture.

use crate::fan::Fan;
use crate::{LensError, require};
use diopter_light::sampling::{self, Grid2};
use glam::{DVec2, Vec2};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Most blades of an iris.
const MOST_BLADES: u32 = 64;
/// Corners that stand for the arc of a curved blade: the shape is this polygon, everywhere.
const CORNERS_PER_BLADE: u32 = 12;

/// The opening that limits the light. Shapes of the same f-number have the same area, so that the number measures light
/// whatever the shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Iris {
    /// A disk.
    #[default]
    Round,
    /// A polygon of straight or curved sides.
    Blades(Arc<Blades>),
    /// Any picture: how much light each place lets through.
    Image(Arc<ApertureImage>),
}

/// Blades of an iris.
#[derive(Clone, Debug, PartialEq)]
pub struct Blades {
    /// At least 3.
    pub count: u32,
    /// Angle of the first corner from +x, rad.
    pub rotation: f32,
    /// 0 for straight edges, 1 for arcs that make a circle.
    pub curvature: f32,
    /// Distance of the corners from the middle, in units of the radius of the disk of equal area.
    corner: f32,
    /// Half planes: outward normal and distance.
    edges: Vec<[f64; 3]>,
    fan: Fan,
}

impl Blades {
    /// Distance of the edge in a direction, corners at distance 1.
    fn edge(count: u32, curvature: f32, angle: f32) -> f32 {
        let half = PI / count as f32;
        // From the middle of the edge.
        let a = (angle.rem_euclid(2.0 * half)) - half;
        if curvature < 1e-4 {
            return half.cos() / a.cos();
        }
        // A circle of radius 1/curvature through both corners.
        let radius = 1.0 / curvature;
        let x = half.cos() - (radius * radius - half.sin().powi(2)).sqrt();
        x * a.cos() + (radius * radius - (x * a.sin()).powi(2)).sqrt()
    }

    /// Corners, counter-clockwise, in units of the radius of the disk of equal area.
    pub fn outline(&self) -> &[DVec2] {
        self.fan.outline()
    }

    /// The sides as half planes x·n ≤ distance: n and distance, in units of the radius of the disk of equal area.
    pub fn edges(&self) -> &[[f64; 3]] {
        &self.edges
    }
}

/// A picture used as an aperture. It fills the square around the disk of the f-number; the light of an all-white square is that
/// of the square.
#[derive(Clone, Debug)]
pub struct ApertureImage {
    width: usize,
    height: usize,
    /// Transmittance 0 to 1, rows from the top.
    values: Vec<f32>,
    grid: Grid2,
    mean: f32,
}

impl PartialEq for ApertureImage {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height) == (other.width, other.height) && self.values == other.values
    }
}

impl Iris {
    /// `count` blades, the first corner at `rotation` rad from +x; `curvature` 0 (straight) to 1 (round). Fails on other
    /// curvatures, on fewer than 3 or more than 64 blades, and on a rotation that is not finite.
    pub fn blades(count: u32, rotation: f32, curvature: f32) -> Result<Self, LensError> {
        require((3..=MOST_BLADES).contains(&count), "number of iris blades", count as f64, "", "3 to 64 (or a round iris)")?;
        require(
            (0.0..=1.0).contains(&curvature),
            "curvature of the iris blades",
            curvature as f64,
            "",
            "0 (straight) to 1 (round)",
        )?;
        require(rotation.is_finite(), "rotation of the iris", rotation as f64, " rad", "a finite angle")?;
        let corners = count * if curvature < 1e-4 { 1 } else { CORNERS_PER_BLADE };
        let point = |i: u32| {
            let angle = TAU * i as f32 / corners as f32;
            DVec2::from_angle((angle + rotation) as f64) * Blades::edge(count, curvature, angle) as f64
        };
        let outline: Vec<DVec2> = (0..corners).map(point).collect();
        let area: f64 = (0..outline.len()).map(|i| 0.5 * outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum();
        let corner = (std::f64::consts::PI / area).sqrt();
        let outline: Vec<DVec2> = outline.iter().map(|p| *p * corner).collect();
        let side = |i: usize| {
            let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
            let normal = -(b - a).perp().normalize();
            [normal.x, normal.y, normal.dot(a)]
        };
        let edges = (0..outline.len()).map(side).collect();
        let fan = Fan::new(DVec2::ZERO, outline);
        Ok(Iris::Blades(Arc::new(Blades { count, rotation, curvature, corner: corner as f32, edges, fan })))
    }

    /// A picture as aperture: transmittances 0 to 1, rows from the top, at least one above 0. Fails on other values, or another
    /// number of them than pixels.
    pub fn image(width: usize, height: usize, values: Vec<f32>) -> Result<Self, LensError> {
        require(
            width > 0 && height > 0 && values.len() == width * height,
            "aperture picture",
            values.len() as f64,
            " values",
            "one for each pixel",
        )?;
        let bad = values.iter().copied().find(|v| !(0.0..=1.0).contains(v));
        require(bad.is_none(), "aperture picture", bad.unwrap_or(0.0) as f64, "", "transmittances from 0 to 1")?;
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        require(mean > 0.0, "aperture picture", mean as f64, "", "some light to pass")?;
        let grid = Grid2::new(&values, width);
        Ok(Iris::Image(Arc::new(ApertureImage { width, height, values, grid, mean })))
    }

    /// Fraction of light that a place lets through, in units of the radius of the disk of equal area; x to the right and y up as
    /// seen from the film.
    #[inline]
    pub fn transmittance(&self, x: f64, y: f64) -> f32 {
        match self {
            Iris::Round => (x * x + y * y <= 1.0) as u32 as f32,
            Iris::Blades(b) => b.edges.iter().all(|[nx, ny, distance]| nx * x + ny * y <= *distance) as u32 as f32,
            Iris::Image(image) => {
                let (u, v) = (0.5 * (x + 1.0), 0.5 * (1.0 - y));
                if !((0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)) {
                    return 0.0;
                }
                let (i, j) = ((u * image.width as f64) as usize, (v * image.height as f64) as usize);
                image.values[j * image.width + i]
            }
        }
    }

    /// Farthest place that lets light through, in units of the radius of the disk of equal area.
    pub fn reach(&self) -> f64 {
        match self {
            Iris::Round => 1.0,
            Iris::Blades(b) => b.corner as f64,
            Iris::Image(_) => std::f64::consts::SQRT_2,
        }
    }

    /// Angle after which the shape repeats, rad; 0 for a round one.
    pub fn period(&self) -> f64 {
        match self {
            Iris::Round => 0.0,
            Iris::Blades(b) => std::f64::consts::TAU / b.count as f64,
            Iris::Image(_) => std::f64::consts::TAU,
        }
    }

    /// Place in the opening, in units of the radius of the disk of equal area, drawn in proportion to what passes.
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        match self {
            Iris::Round => sampling::disk(u),
            Iris::Blades(b) => b.fan.sample(u).as_vec2(),
            Iris::Image(image) => {
                let (uv, _) = image.grid.sample(u);
                Vec2::new(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y)
            }
        }
    }

    /// Light let through over that of the disk.
    pub fn relative_area(&self) -> f64 {
        match self {
            Iris::Round | Iris::Blades(_) => 1.0,
            Iris::Image(image) => 4.0 * image.mean as f64 / std::f64::consts::PI,
        }
    }

    /// For facts and reports: empty for a round one.
    pub fn describe(&self) -> String {
        match self {
            Iris::Round => String::new(),
            Iris::Blades(b) if b.curvature > 0.0 => format!("{} curved blades", b.count),
            Iris::Blades(b) => format!("{} blades", b.count),
            Iris::Image(i) => format!("aperture picture {} x {}", i.width, i.height),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_the_area_of_the_unit_disk() {
        for (count, curvature) in [(3, 0.0), (5, 0.0), (8, 0.5), (15, 0.0), (6, 0.9), (5, 1.0)] {
            let iris = Iris::blades(count, 0.4, curvature).unwrap();
            let (n, mut inside) = (800, 0);
            let reach = iris.reach() as f32 * 1.001;
            for i in 0..n * n {
                let p = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / (n as f32 / 2.0) - 1.0;
                inside += (iris.transmittance((p.x * reach) as f64, (p.y * reach) as f64) > 0.0) as u32;
            }
            let area = inside as f32 / (n * n) as f32 * 4.0 * reach * reach;
            assert!((area / PI - 1.0).abs() < 4e-3, "{count} {curvature}: {area}");
            for i in 0..400 {
                let p = iris.sample([(i % 20) as f32 / 20.0 + 0.01, (i / 20) as f32 / 20.0 + 0.01]) * 0.999;
                assert!(iris.transmittance(p.x as f64, p.y as f64) > 0.0, "{count} {p}");
            }
        }
    }

    #[test]
    fn a_picture_lets_light_through_where_it_is_white() {
        let iris = Iris::image(2, 2, vec![1.0, 0.0, 0.0, 0.5]).unwrap();
        assert_eq!(iris.transmittance(-0.5, 0.5), 1.0);
        assert_eq!(iris.transmittance(0.5, -0.5), 0.5);
        assert_eq!(iris.transmittance(0.5, 0.5), 0.0);
        let upper = (0..1000).filter(|i| iris.sample([*i as f32 / 1000.0, (*i * 7 % 1000) as f32 / 1000.0]).y > 0.0).count();
        assert!((640..700).contains(&upper), "{upper}");
        assert!(Iris::image(2, 1, vec![0.0, 0.0]).is_err() && Iris::blades(2, 0.0, 0.0).is_err());
    }
}
