//! A polygon seen from a point inside it, and points drawn evenly over it.

use glam::DVec2;

/// Entries of the table that finds a triangle.
const GUIDE: usize = 64;

/// A star-shaped polygon as triangles around a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Fan {
    center: DVec2,
    /// Counter-clockwise.
    outline: Vec<DVec2>,
    /// Fraction of the area before each triangle; one more entry, 1.
    before: Vec<f64>,
    /// First triangle to look at for each 1/[`GUIDE`].
    guide: Vec<u16>,
    area: f64,
}

impl Fan {
    /// Triangles of a counter-clockwise outline that `center` sees all of. Fewer than three corners make an empty fan.
    pub fn new(center: DVec2, outline: Vec<DVec2>) -> Fan {
        let n = outline.len();
        if n < 3 {
            return Fan { center, outline: vec![], before: vec![0.0, 1.0], guide: vec![0; GUIDE], area: 0.0 };
        }
        let areas: Vec<f64> =
            (0..n).map(|i| (0.5 * (outline[i] - center).perp_dot(outline[(i + 1) % n] - center)).max(0.0)).collect();
        let area: f64 = areas.iter().sum();
        let mut sum = 0.0;
        let mut before = vec![0.0];
        for a in &areas {
            sum += a;
            before.push(sum / area);
        }
        before[n] = 1.0;
        let guide = (0..GUIDE)
            .map(|g| before.partition_point(|b| *b <= g as f64 / GUIDE as f64).saturating_sub(1).min(n - 1) as u16)
            .collect();
        Fan { center, outline, before, guide, area }
    }

    /// Area, in the square of the outline's unit.
    #[inline]
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Middle.
    pub fn center(&self) -> DVec2 {
        self.center
    }

    /// Corners.
    pub fn outline(&self) -> &[DVec2] {
        &self.outline
    }

    /// The point that belongs to `u` in the unit square; even over the area. The fan must not be empty.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> DVec2 {
        let (u0, u1) = (u[0] as f64, u[1] as f64);
        let mut i = self.guide[(u0 * GUIDE as f64) as usize & (GUIDE - 1)] as usize;
        while self.before[i + 1] <= u0 && i + 2 < self.before.len() {
            i += 1;
        }
        let along = ((u0 - self.before[i]) / (self.before[i + 1] - self.before[i])).clamp(0.0, 1.0);
        let (a, b) = (self.outline[i], self.outline[if i + 1 == self.outline.len() { 0 } else { i + 1 }]);
        // Rings of equal area: along the edge by what is left of u₀, outwards by √u₁.
        self.center + (a + (b - a) * along - self.center) * u1.sqrt()
    }

    /// Whether a point lies inside.
    #[cfg(test)]
    fn contains(&self, p: DVec2) -> bool {
        let n = self.outline.len();
        let from = p - self.center;
        (0..n).any(|i| {
            let (a, b) = (self.outline[i] - self.center, self.outline[(i + 1) % n] - self.center);
            a.perp_dot(from) >= 0.0 && from.perp_dot(b) >= 0.0 && (b - a).perp_dot(from - a) >= 0.0
        })
    }
}

/// Convex hull, counter-clockwise (Andrew 1979).
pub fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut hull: Vec<DVec2> = vec![];
    for pass in 0..2 {
        let start = hull.len();
        let chain: Box<dyn Iterator<Item = &DVec2>> =
            if pass == 0 { Box::new(points.iter()) } else { Box::new(points.iter().rev()) };
        for p in chain {
            while hull.len() >= start + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp_dot(*p - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(*p);
        }
        hull.pop();
    }
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_even_over_the_area() {
        let outline = vec![DVec2::new(2.0, 0.0), DVec2::new(0.0, 1.0), DVec2::new(-1.0, 0.0), DVec2::new(0.0, -3.0)];
        let fan = Fan::new(DVec2::new(0.1, -0.2), outline);
        assert!((fan.area() - 6.0).abs() < 1e-12);
        let n = 300;
        let (mut inside, mut mean) = (0, DVec2::ZERO);
        for i in 0..n * n {
            let p = fan.sample([((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32]);
            inside += fan.contains(p * 0.9999) as u32;
            mean += p / (n * n) as f64;
        }
        assert!(inside as f64 > 0.999 * (n * n) as f64, "{inside}");
        // Centroid of the two triangles left and right of the y axis: areas 4 and 2.
        let expected = (DVec2::new(2.0, -2.0) / 3.0 * 4.0 + DVec2::new(-1.0, -2.0) / 3.0 * 2.0) / 6.0;
        assert!((mean - expected).length() < 3e-3, "{mean} {expected}");
    }

    #[test]
    fn the_hull_holds_every_point() {
        let points: Vec<DVec2> = (0..200).map(|i| DVec2::new((i * 37 % 101) as f64, (i * 53 % 97) as f64)).collect();
        let hull = convex_hull(points.clone());
        let fan = Fan::new(DVec2::new(50.0, 48.0), hull.clone());
        assert!(hull.len() >= 4 && points.iter().all(|p| fan.contains(DVec2::new(50.0, 48.0).lerp(*p, 1.0 - 1e-9))));
    }
}
