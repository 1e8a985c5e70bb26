//! The shape of the aperture.

use diopter_light::sampling;
use glam::Vec2;
use std::f32::consts::{PI, TAU};

/// The opening that limits the light. Shapes of the same f-number have the same area, so that the number measures light
/// whatever the shape.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Iris {
    /// A disk.
    #[default]
    Round,
    /// A regular polygon.
    Blades {
        /// Corners, at least 3.
        count: u32,
        /// Angle of the first corner from +x, rad.
        rotation: f32,
    },
}

impl Iris {
    /// Place in the opening, in units of the radius of the disk of equal area.
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        match *self {
            Iris::Round => sampling::disk(u),
            Iris::Blades { count, rotation } => {
                let n = count as f32;
                sampling::regular_polygon(u, count, rotation) * (PI / (0.5 * n * (TAU / n).sin())).sqrt()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_the_area_of_the_unit_disk() {
        // The corner of an n-gon of area π lies at √(π / (n/2 sin(2π/n))); nothing lies beyond.
        for count in [3, 5, 8, 15] {
            let iris = Iris::Blades { count, rotation: 0.4 };
            let n = count as f32;
            let corner = (PI / (0.5 * n * (TAU / n).sin())).sqrt();
            let mut farthest = 0.0f32;
            for i in 0..400 {
                for j in 0..40 {
                    farthest = farthest.max(iris.sample([i as f32 / 400.0, j as f32 / 39.0]).length());
                }
            }
            assert!(farthest <= corner * 1.0001 && farthest > corner * 0.98, "{count}: {farthest} {corner}");
        }
    }
}
