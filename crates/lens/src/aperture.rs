//! Apertures of surfaces that are not disks about the vertex, obscurations, and spiders.
//!
//! Every [`Aperture`] of a surface must let a ray through, beside the disk of its semi-diameter. Millimetres, in the surface's own frame,
//! by x and y of the point where the ray meets the surface (Zemax "Surface Apertures", CODE V "REX, REY, ELX, ELY"). Edges let through;
//! of an obscuration they block.

use std::f64::consts::TAU;

/// Most arms of a spider.
pub const MOST_ARMS: u32 = 32;
/// Largest half width or distance from the vertex, mm.
const LARGEST: f64 = 1e6;

/// Shape of an aperture, before it is moved and turned.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Outline {
    /// Half widths in x and y.
    Rectangle([f64; 2]),
    /// Half axes in x and y.
    Ellipse([f64; 2]),
    /// Inner and outer radius.
    Ring([f64; 2]),
    /// Arms of a width (mm) from the middle outwards without end, at equal angles; the first along +x.
    Spider {
        /// Number of arms.
        arms: u32,
        /// Width of each.
        width: f64,
    },
}

/// An opening, or an obscuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aperture {
    outline: Outline,
    blocks: bool,
    center: [f64; 2],
    rotation_deg: f64,
    /// Cosine and sine of the rotation.
    axis: [f64; 2],
}

impl Aperture {
    /// `blocks`: light is stopped inside the outline, else outside of it. `center` in mm; `rotation_deg` from +x towards +y. Fails on sizes
    /// that are not positive, on a middle that is no place, beyond 360°, and on a spider that does not block.
    pub fn new(outline: Outline, blocks: bool, center: [f64; 2], rotation_deg: f64) -> Result<Aperture, String> {
        let is_size = |v: f64| v > 0.0 && v < LARGEST;
        match outline {
            Outline::Rectangle(half) | Outline::Ellipse(half) => {
                if !half.iter().all(|h| is_size(*h)) {
                    return Err(format!("aperture of half widths {half:?}: expected two positive lengths in mm"));
                }
            }
            Outline::Ring([inner, outer]) => {
                if !(inner >= 0.0 && inner < outer && outer < LARGEST) {
                    return Err(format!("ring from {inner} to {outer}: expected 0 or more, then a larger radius in mm"));
                }
            }
            Outline::Spider { arms, width } => {
                if !(1..=MOST_ARMS).contains(&arms) || !is_size(width) {
                    let what = format!("spider of {arms} arms, width {width}");
                    return Err(format!("{what}: expected 1 to {MOST_ARMS} arms and a positive width in mm"));
                }
                if !blocks {
                    return Err("a spider blocks: expected it among the obscurations".into());
                }
            }
        }
        if !center.iter().all(|c| c.abs() < LARGEST) {
            return Err(format!("aperture at {center:?}: expected two lengths in mm"));
        }
        if !(rotation_deg.abs() <= 360.0) {
            return Err(format!("aperture turned by {rotation_deg}: expected degrees within 360"));
        }
        let (sin, cos) = rotation_deg.to_radians().sin_cos();
        Ok(Aperture { outline, blocks, center, rotation_deg, axis: [cos, sin] })
    }

    /// Its shape.
    pub fn outline(&self) -> Outline {
        self.outline
    }

    /// Whether it is an obscuration.
    pub fn blocks(&self) -> bool {
        self.blocks
    }

    /// Its middle, mm.
    pub fn center(&self) -> [f64; 2] {
        self.center
    }

    /// Turn from +x towards +y, degrees.
    pub fn rotation_deg(&self) -> f64 {
        self.rotation_deg
    }

    /// Whether light passes at a place.
    #[inline]
    pub fn lets_through(&self, x: f64, y: f64) -> bool {
        let (x, y) = (x - self.center[0], y - self.center[1]);
        let [cos, sin] = self.axis;
        let (u, v) = (x * cos + y * sin, y * cos - x * sin);
        let inside = match self.outline {
            Outline::Rectangle([a, b]) => u.abs() <= a && v.abs() <= b,
            Outline::Ellipse([a, b]) => (u / a).powi(2) + (v / b).powi(2) <= 1.0,
            Outline::Ring([inner, outer]) => {
                let r2 = u * u + v * v;
                r2 >= inner * inner && r2 <= outer * outer
            }
            Outline::Spider { arms, width } => (0..arms).any(|i| {
                let (s, c) = (TAU * i as f64 / arms as f64).sin_cos();
                u * c + v * s >= 0.0 && (v * c - u * s).abs() <= 0.5 * width
            }),
        };
        inside != self.blocks
    }

    /// Largest distance from the vertex at which light passes, mm; infinite for an obscuration.
    pub fn reach(&self) -> f64 {
        if self.blocks {
            return f64::INFINITY;
        }
        let [cos, sin] = self.axis;
        let [cx, cy] = self.center;
        // The vertex seen from the outline's own axes.
        let (u, v) = ((cx * cos + cy * sin).abs(), (cy * cos - cx * sin).abs());
        match self.outline {
            Outline::Rectangle([a, b]) => (u + a).hypot(v + b),
            // Exact on the axes, else not less than what is right.
            Outline::Ellipse([a, b]) => match (u, v) {
                (0.0, 0.0) => a.max(b),
                _ => u.hypot(v) + a.max(b),
            },
            Outline::Ring([_, outer]) => u.hypot(v) + outer,
            Outline::Spider { .. } => f64::INFINITY,
        }
    }

    /// Lower and upper corner of the rectangle that holds all that it lets through, mm; `None` of what blocks.
    pub fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let [cos, sin] = self.axis;
        let half = match self.outline {
            _ if self.blocks => return None,
            Outline::Rectangle([a, b]) => [(a * cos).abs() + (b * sin).abs(), (a * sin).abs() + (b * cos).abs()],
            Outline::Ellipse([a, b]) => [(a * cos).hypot(b * sin), (a * sin).hypot(b * cos)],
            Outline::Ring([_, outer]) => [outer; 2],
            Outline::Spider { .. } => return None,
        };
        let [x, y] = self.center;
        Some([[x - half[0], y - half[1]], [x + half[0], y + half[1]]])
    }

    /// Lengths in another unit: multiplied by `scale`.
    pub(crate) fn scaled(self, scale: f64) -> Aperture {
        let both = |v: [f64; 2]| v.map(|v| v * scale);
        let outline = match self.outline {
            Outline::Rectangle(half) => Outline::Rectangle(both(half)),
            Outline::Ellipse(half) => Outline::Ellipse(both(half)),
            Outline::Ring(radii) => Outline::Ring(both(radii)),
            Outline::Spider { arms, width } => Outline::Spider { arms, width: width * scale },
        };
        Aperture { outline, center: both(self.center), ..self }
    }

    /// Seen after half a turn about the x axis: y changes its sign.
    pub(crate) fn turned_over(self) -> Aperture {
        let [cx, cy] = self.center;
        let [cos, sin] = self.axis;
        // Arms stand at equal angles from the first, so that mirroring that one mirrors them all.
        Aperture { center: [cx, -cy], rotation_deg: -self.rotation_deg, axis: [cos, -sin], ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fraction of a square of a side (mm) about the vertex that is open, on a grid.
    fn open_area(apertures: &[Aperture], side: f64) -> f64 {
        const GRID: usize = 800;
        let at = |i: usize| side * ((i as f64 + 0.5) / GRID as f64 - 0.5);
        let open = (0..GRID * GRID).filter(|i| apertures.iter().all(|a| a.lets_through(at(i % GRID), at(i / GRID)))).count();
        open as f64 / (GRID * GRID) as f64 * side * side
    }

    #[test]
    fn open_areas_are_those_of_the_shapes() {
        let new = |outline, blocks, center, turn| Aperture::new(outline, blocks, center, turn).unwrap();
        let rectangle = new(Outline::Rectangle([6.0, 2.0]), false, [1.0, -0.5], 30.0);
        let ellipse = new(Outline::Ellipse([7.0, 3.0]), false, [-0.5, 1.0], -50.0);
        // A grid of 0.025 mm counts areas to its cell times the length of the edge, in both directions: 0.1 mm².
        assert!((open_area(&[rectangle], 20.0) - 48.0).abs() < 0.1);
        assert!((open_area(&[ellipse], 20.0) - 21.0 * std::f64::consts::PI).abs() < 0.1);
        // Obscurations: a ring, and three arms of 1 mm from the middle of a disk of 8 mm. Two arms overlap near the middle in what
        // the strips share, so the exact value is for one arm: a strip of half the disk.
        let ring = new(Outline::Ring([2.0, 3.0]), true, [0.0; 2], 0.0);
        assert!((open_area(&[ring], 20.0) - (400.0 - 5.0 * std::f64::consts::PI)).abs() < 0.1);
        let disk = new(Outline::Ring([0.0, 8.0]), false, [0.0; 2], 0.0);
        let arm = new(Outline::Spider { arms: 1, width: 1.0 }, true, [0.0; 2], 77.0);
        // ∫ of √(64 − v²) over |v| ≤ 1/2.
        let strip = 0.5 * (64.0f64 - 0.25).sqrt() + 64.0 * (0.5f64 / 8.0).asin();
        let expected = 64.0 * std::f64::consts::PI - strip;
        assert!((open_area(&[disk, arm], 20.0) - expected).abs() < 0.1, "{} {expected}", open_area(&[disk, arm], 20.0));
    }

    #[test]
    fn places_are_turned_and_moved() {
        let square = Aperture::new(Outline::Rectangle([4.0, 1.0]), false, [10.0, 0.0], 90.0).unwrap();
        // Turned by a quarter it is long in y.
        assert!(square.lets_through(10.9, 3.9) && !square.lets_through(13.0, 0.0) && !square.lets_through(0.0, 0.0));
        assert!((square.reach() - 11.0f64.hypot(4.0)).abs() < 1e-12);
        let spider = Aperture::new(Outline::Spider { arms: 3, width: 0.2 }, true, [0.0; 2], 90.0).unwrap();
        // Arms at 90°, 210° and 330°: none towards −y.
        assert!(!spider.lets_through(0.0, 5.0) && spider.lets_through(0.0, -5.0));
        let (s, c) = 210.0f64.to_radians().sin_cos();
        assert!(!spider.lets_through(5.0 * c, 5.0 * s) && spider.lets_through(-5.0 * c, -5.0 * s));
        let over = spider.turned_over();
        assert!(over.lets_through(0.0, 5.0) && !over.lets_through(0.0, -5.0) && !over.lets_through(5.0 * c, -5.0 * s));
    }

    #[test]
    fn sizes_that_no_aperture_has_are_refused() {
        let bad = |outline, blocks| Aperture::new(outline, blocks, [0.0; 2], 0.0).unwrap_err();
        assert!(bad(Outline::Rectangle([0.0, 1.0]), false).contains("two positive lengths"));
        assert!(bad(Outline::Ellipse([1.0, f64::NAN]), false).contains("two positive lengths"));
        assert!(bad(Outline::Ring([3.0, 2.0]), true).contains("then a larger radius"));
        assert!(bad(Outline::Spider { arms: 0, width: 1.0 }, true).contains("1 to 32 arms"));
        assert!(bad(Outline::Spider { arms: 3, width: 1.0 }, false).contains("among the obscurations"));
        assert!(Aperture::new(Outline::Ring([0.0, 1.0]), true, [f64::NAN, 0.0], 0.0).is_err());
    }
}
