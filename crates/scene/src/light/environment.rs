//! Light from all around: one colour, or a lat-long map.
//!
//! The map's middle row is the horizon of its own frame: +y up, column 0 at −z turning through −x ... as seen from inside
//! (u = atan2(x, −z)/2π + ½, v = acos(y)/π). Directions are drawn in proportion to luminance × sin θ.

use super::{Aim, Spot};
use diopter_image::Raster;
use diopter_light::sampling::Grid2;
use diopter_light::{Sampled, Spectrum, Wavelengths};
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Surroundings infinitely far away.
#[derive(Clone, Debug)]
pub struct Environment {
    map: Raster<f32>,
    /// Turns directions of the map into directions of the world.
    world_from_map: Mat3,
    scale: f32,
    grid: Grid2,
    mean_luminance: f32,
}

const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

impl Environment {
    /// From a lat-long map of linear sRGB in cd/m², times `scale`. Numbers that are negative or not finite count as 0.
    pub fn new(mut map: Raster<f32>, world_from_map: Mat3, scale: f32) -> Self {
        map.data.iter_mut().filter(|v| !(**v >= 0.0 && v.is_finite())).for_each(|v| *v = 0.0);
        let (width, height) = (map.width, map.height);
        let mut weights = Vec::with_capacity(width * height);
        let (mut sum, mut total) = (0.0f64, 0.0f64);
        for row in 0..height {
            let sin = (PI * (row as f32 + 0.5) / height as f32).sin();
            for column in 0..width {
                // Bilinear lookup reaches into the neighbours: so must the weight.
                let p = |c: usize, r: usize| Vec3::from_slice(map.pixel(c, r)).dot(LUMINANCE);
                let around = [
                    (column, row),
                    ((column + 1) % width, row),
                    ((column + width - 1) % width, row),
                    (column, (row + 1).min(height - 1)),
                    (column, row.saturating_sub(1)),
                ];
                let here = p(column, row);
                let reach = around.iter().map(|(c, r)| p(*c, *r)).fold(0.0, f32::max);
                weights.push((0.75 * here + 0.25 * reach) * sin);
                sum += (here * sin) as f64;
                total += sin as f64;
            }
        }
        let grid = Grid2::new(&weights, width);
        let mean_luminance = (sum / total.max(1e-30)) as f32 * scale;
        Environment { map, world_from_map, scale, grid, mean_luminance }
    }

    /// The same linear sRGB colour (cd/m²) from everywhere.
    pub fn uniform(rgb: Vec3) -> Self {
        let mut map = Raster::new(8, 4, 3);
        map.data.chunks_exact_mut(3).for_each(|p| p.copy_from_slice(&rgb.to_array()));
        Environment::new(map, Mat3::IDENTITY, 1.0)
    }

    /// Mean luminance over all directions, cd/m².
    pub fn mean_luminance(&self) -> f32 {
        self.mean_luminance
    }

    /// Multiplies all of its light.
    pub fn scale_light(&mut self, factor: f32) {
        self.scale *= factor;
        self.mean_luminance *= factor;
    }

    fn place(&self, direction: Vec3) -> Vec2 {
        let d = self.world_from_map.transpose() * direction;
        // atan2 keeps its digits near the poles, where acos would not.
        Vec2::new(d.x.atan2(-d.z) / TAU + 0.5, d.x.hypot(d.z).atan2(d.y) / PI)
    }

    /// Linear sRGB in cd/m² from a direction, bilinear.
    pub fn rgb(&self, direction: Vec3) -> Vec3 {
        let (w, h) = (self.map.width, self.map.height);
        let p = self.place(direction) * Vec2::new(w as f32, h as f32) - 0.5;
        let (x, y) = (p.x.floor(), p.y.floor());
        let (fx, fy) = (p.x - x, p.y - y);
        let column = |i: f32| (i as i64).rem_euclid(w as i64) as usize;
        let row = |i: f32| (i.max(0.0) as usize).min(h - 1);
        let at = |c: f32, r: f32| Vec3::from_slice(self.map.pixel(column(c), row(r)));
        let top = at(x, y).lerp(at(x + 1.0, y), fx);
        let bottom = at(x, y + 1.0).lerp(at(x + 1.0, y + 1.0), fx);
        top.lerp(bottom, fy) * self.scale
    }

    /// Spectral radiance from a direction.
    #[inline]
    pub fn radiance(&self, direction: Vec3, wavelengths: &Wavelengths) -> Sampled {
        Spectrum::light_from_rgb(self.rgb(direction)).sample(wavelengths)
    }

    pub(super) fn aim(&self, u: [f32; 2]) -> Option<Aim> {
        let (p, density) = self.grid.sample(u);
        let (theta, phi) = (p.y * PI, (p.x - 0.5) * TAU);
        let sin = theta.sin();
        let d = Vec3::new(sin * phi.sin(), theta.cos(), -sin * phi.cos());
        let pdf = density / (2.0 * PI * PI * sin);
        let wi = self.world_from_map * d;
        (pdf > 0.0 && pdf.is_finite()).then_some(Aim {
            wi,
            distance: f32::INFINITY,
            pdf,
            has_extent: true,
            spot: Spot::Environment,
        })
    }

    /// Density in solid angle with which a direction is drawn.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let p = self.place(direction);
        let sin = (p.y * PI).sin();
        if sin > 0.0 { self.grid.pdf(p) / (2.0 * PI * PI * sin) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn gradient() -> Environment {
        let mut map = Raster::new(32, 16, 3);
        for row in 0..16 {
            for column in 0..32 {
                let v = if (row, column) == (4, 9) { 300.0 } else { 1.0 + row as f32 };
                map.pixel_mut(column, row).fill(v);
            }
        }
        Environment::new(map, Mat3::from_rotation_y(0.7), 2.0)
    }

    #[test]
    fn aims_have_the_density_they_claim_and_give_the_mean() {
        let env = gradient();
        let (n, mut sum, mut solid) = (300u32, 0.0f64, 0.0f64);
        for i in 0..n * n {
            let u = [(i % n) as f32 + to_unit(mix(i)), (i / n) as f32 + to_unit(mix(i ^ 0xffff))].map(|x| x / n as f32);
            let aim = env.aim(u).unwrap();
            assert!((env.pdf(aim.wi) / aim.pdf - 1.0).abs() < 0.05, "{} {}", env.pdf(aim.wi), aim.pdf);
            sum += (env.rgb(aim.wi).x / aim.pdf) as f64;
            solid += (1.0 / aim.pdf) as f64;
        }
        let count = (n * n) as f64;
        assert!((solid / count / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{}", solid / count);
        let mean = sum / count / (4.0 * std::f64::consts::PI);
        assert!((mean / env.mean_luminance() as f64 - 1.0).abs() < 0.02, "{mean} {}", env.mean_luminance());
    }

    #[test]
    fn up_is_the_top_row() {
        let mut map = Raster::new(8, 4, 3);
        map.pixel_mut(3, 0).fill(8.0);
        (0..8).for_each(|c| map.pixel_mut(c, 0).fill(8.0));
        let env = Environment::new(map, Mat3::IDENTITY, 1.0);
        assert_eq!(env.rgb(Vec3::Y).x, 8.0);
        assert_eq!(env.rgb(Vec3::NEG_Y).x, 0.0);
    }
}
