//! Emissive surfaces as lights: triangles, parallelograms, spheres.
//!
//! Sources: Ureña, Fajardo & King 2013, "An Area-Preserving Parametrization for Spherical Rectangles" (EGSR); PBR 6.2.4 and
//! 12.4 (cone of a sphere). Other parallelograms and triangles are sampled by area.

use super::lanes::{arccosines, square_roots};
use super::{LightPoint, LightSample, clearance, segment::Pivot, tree::LightBounds};
use crate::bvh::Bounds;
use crate::material::{Emission, EmissionColor, Material};
use crate::shape::{Quad, Sphere, reach_of};
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum, sampling};
use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use std::f32::consts::{PI, TAU};

/// An emissive surface.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// Where it is.
    pub shape: AreaShape,
    /// Material with the emission.
    pub material: u32,
    /// Texture coordinates at the corners of a triangle.
    pub uv: [[Vec2; 3]; 2],
    /// Alpha of a triangle's corners, 1 of other shapes: multiplies the coverage of its material, as it does where rays hit.
    pub alpha: [f32; 3],
    /// Whether the back shines too.
    pub two_sided: bool,
    /// Mean luminance, cd/m²; steers the choice among lights.
    pub luminance: f32,
    /// Unit normal of a flat shape.
    normal: Vec3,
    /// m².
    area: f32,
    /// Of a rectangle: what it is sampled by. `None` of skewed parallelograms and other shapes.
    rectangle: Option<Rectangle>,
}

/// Shape of an emissive surface, world space.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum AreaShape {
    /// Corner and edges (α, β with α + β ≤ 1).
    Triangle(Quad),
    /// Corner and edges.
    Parallelogram(Quad),
    /// Outside of a sphere.
    Sphere(Sphere),
}

impl AreaLight {
    /// A light of a shape in the world (m), with the emission of a material by its number; `uv`: texture coordinates `[set][corner]`; `luminance`: its mean, cd/m².
    pub fn new(shape: AreaShape, material: u32, uv: [[Vec2; 3]; 2], two_sided: bool, luminance: f32) -> Self {
        let (normal, area) = match &shape {
            AreaShape::Triangle(q) => (q.normal(), 0.5 * q.area()),
            AreaShape::Parallelogram(q) => (q.normal(), q.area()),
            AreaShape::Sphere(s) => (Vec3::ZERO, 4.0 * PI * s.radius * s.radius),
        };
        let rectangle = match &shape {
            AreaShape::Parallelogram(q) => Rectangle::of(q),
            _ => None,
        };
        AreaLight { shape, material, uv, alpha: [1.0; 3], two_sided, luminance, normal, area, rectangle }
    }

    /// The same light with other alphas (0 to 1) of its corners.
    #[must_use]
    pub fn with_alpha(self, alpha: [f32; 3]) -> Self {
        AreaLight { alpha, ..self }
    }

    /// The light when its space is placed in the world. Flat shapes only.
    pub(crate) fn placed(&self, place: &glam::Affine3A) -> AreaLight {
        let quad =
            |q: &Quad| Quad { corner: place.transform_point3(q.corner), edges: q.edges.map(|e| place.transform_vector3(e)) };
        let shape = match &self.shape {
            AreaShape::Triangle(q) => AreaShape::Triangle(quad(q)),
            AreaShape::Parallelogram(q) => AreaShape::Parallelogram(quad(q)),
            AreaShape::Sphere(s) => AreaShape::Sphere(*s),
        };
        let mut light = AreaLight::new(shape, self.material, self.uv, self.two_sided, self.luminance).with_alpha(self.alpha);
        if place.matrix3.determinant() < 0.0 {
            light.normal = -light.normal;
        }
        light
    }

    /// Its greatest coordinate in any direction, m.
    pub fn reach(&self) -> f32 {
        match &self.shape {
            AreaShape::Triangle(q) => reach_of([q.corner, q.corner + q.edges[0], q.corner + q.edges[1]]),
            AreaShape::Parallelogram(q) => reach_of(q.corners()),
            AreaShape::Sphere(s) => reach_of([s.center]) + s.radius,
        }
    }

    /// Area, m².
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Area along its normal, m²; nothing of a ball, which is closed.
    pub fn area_vector(&self) -> Vec3 {
        match &self.shape {
            AreaShape::Triangle(q) | AreaShape::Parallelogram(q) => self.area * q.normal(),
            AreaShape::Sphere(_) => Vec3::ZERO,
        }
    }

    /// What the light tree needs to know.
    pub fn bounds(&self) -> LightBounds {
        let power = self.area * self.luminance * PI * if self.two_sided { 2.0 } else { 1.0 };
        let (bounds, axis, spread) = match &self.shape {
            AreaShape::Triangle(q) => (Bounds::around([q.corner, q.corner + q.edges[0], q.corner + q.edges[1]]), q.normal(), 0.0),
            AreaShape::Parallelogram(q) => (Bounds::around(q.corners()), q.normal(), 0.0),
            AreaShape::Sphere(s) => (Bounds { min: s.center - s.radius, max: s.center + s.radius }, Vec3::Z, PI),
        };
        LightBounds::new(bounds, axis, spread, PI / 2.0, self.two_sided, power)
    }

    /// What equi-angular sampling needs to know.
    pub(crate) fn pivot(&self) -> Pivot {
        let (middle, area) = match &self.shape {
            AreaShape::Triangle(q) => (q.corner + (q.edges[0] + q.edges[1]) / 3.0, self.area),
            AreaShape::Parallelogram(q) => (q.point(Vec2::splat(0.5)), self.area),
            AreaShape::Sphere(s) => return Pivot::of_area(s.center, PI * s.radius * s.radius, None),
        };
        Pivot::of_area(middle, area, (!self.two_sided).then_some((self.normal, 0.0)))
    }

    /// Radiance at a place of the surface (barycentric weights of the second and third corner, or (α, β)), W·m⁻²·sr⁻¹·nm⁻¹, times the fraction of rays that meet the
    /// surface there; 0 without an emission.
    pub fn radiance(&self, place: Vec2, materials: &[Material], wavelengths: &SampledWavelengths) -> SampledSpectrum {
        let material = &materials[self.material as usize];
        let Some(emission) = &material.emission else { return SampledSpectrum::ZERO };
        let (uv, fraction) = self.covered(place, material);
        emission.sample(&uv, wavelengths) * fraction
    }

    /// Texture coordinates of a place, and the fraction of rays that meet the surface there.
    fn covered(&self, place: Vec2, material: &Material) -> ([Vec2; 2], f32) {
        let first = 1.0 - place.x - place.y;
        let uv = self.uv.map(|[a, b, c]| a * first + b * place.x + c * place.y);
        // Where a surface has holes it does not shine either.
        let [a, b, c] = self.alpha;
        (uv, material.coverage.fraction(&uv, a * first + b * place.x + c * place.y))
    }

    /// [`AreaLight::radiance`] over the spectrum of [`AreaLight::carrier`].
    pub(crate) fn relative_radiance(
        &self,
        place: Vec2,
        materials: &[Material],
        wavelengths: &SampledWavelengths,
    ) -> SampledSpectrum {
        match self.carrier(materials) {
            // A constant spectrum: what is left is the fraction that is there.
            Some(_) => SampledSpectrum::splat(self.covered(place, &materials[self.material as usize]).1),
            None => {
                self.radiance(place, materials, wavelengths)
                    / wavelengths.d65_one_nit().max(SampledSpectrum::splat(f32::MIN_POSITIVE))
            }
        }
    }

    /// The spectrum that all of its surface has; `None` where colours differ, which are times D65 of 1 cd/m².
    pub(crate) fn carrier<'a>(&self, materials: &'a [Material]) -> Option<&'a Spectrum> {
        match &materials[self.material as usize].emission {
            Some(Emission { radiance: EmissionColor::Constant(spectrum), .. }) => Some(spectrum),
            _ => None,
        }
    }

    /// A point of the surface, uniform by area, its outer normal and its place for [`AreaLight::radiance`].
    pub(crate) fn sample_surface(&self, u: [f32; 2]) -> (Vec3, Vec3, Vec2) {
        match &self.shape {
            AreaShape::Sphere(s) => {
                let n = sampling::sphere(u);
                (s.center + n * s.radius, n, Vec2::ZERO)
            }
            AreaShape::Triangle(quad) => {
                let place = triangle_place(u);
                (quad.point(place), self.normal, place)
            }
            AreaShape::Parallelogram(quad) => {
                let place = Vec2::from(u);
                (quad.point(place), self.normal, place)
            }
        }
    }

    /// Outer normal at a point of it.
    #[inline]
    pub(crate) fn outer_normal(&self, point: Vec3) -> Vec3 {
        match &self.shape {
            AreaShape::Sphere(s) => (point - s.center) / s.radius,
            _ => self.normal,
        }
    }

    /// Outer normal of a flat shape; `None` of a sphere.
    pub(crate) fn normal(&self) -> Option<Vec3> {
        (!matches!(self.shape, AreaShape::Sphere(_))).then_some(self.normal)
    }

    /// Cosine between its normal at a point of it and a direction.
    #[inline]
    pub(crate) fn cosine(&self, point: Vec3, direction: Vec3) -> f32 {
        self.outer_normal(point).dot(direction).abs()
    }

    /// Its middle.
    pub(crate) fn center(&self) -> Vec3 {
        match &self.shape {
            AreaShape::Sphere(s) => s.center,
            AreaShape::Triangle(q) => q.point(Vec2::splat(1.0 / 3.0)),
            AreaShape::Parallelogram(q) => q.point(Vec2::splat(0.5)),
        }
    }

    /// Samples the surface from a point.
    pub(crate) fn sample_li(&self, p: Vec3, u: [f32; 2], number: u32) -> Option<LightSample> {
        match &self.shape {
            AreaShape::Sphere(sphere) => sample_li_sphere(sphere, p, u, number),
            AreaShape::Triangle(quad) => self.sample_li_plane(quad, p, triangle_place(u), number),
            AreaShape::Parallelogram(quad) => match self.rectangle.and_then(|r| r.seen_from(p, self.area)) {
                Some(rectangle) => {
                    let place = rectangle.sample(u);
                    let mut light_sample = self.sample_li_plane(quad, p, place, number)?;
                    light_sample.pdf = 1.0 / rectangle.solid_angle;
                    Some(light_sample)
                }
                None => self.sample_li_plane(quad, p, Vec2::from(u), number),
            },
        }
    }

    fn sample_li_plane(&self, quad: &Quad, p: Vec3, place: Vec2, number: u32) -> Option<LightSample> {
        let to = quad.point(place) - p;
        let d2 = to.length_squared();
        let distance = d2.sqrt();
        let wi = to / distance;
        let cos = -self.normal.dot(wi);
        if !(if self.two_sided { cos.abs() } else { cos } > 1e-6) {
            return None;
        }
        let pdf = d2 / (cos.abs() * self.area);
        Some(LightSample {
            wi,
            distance,
            pdf,
            has_extent: true,
            spot: LightPoint::Area(number, place),
            clearance: clearance(p, p + to, distance, cos),
        })
    }

    /// Density of `sample_li`, 1/sr, from `p` (m) along the unit vector `wi`, which meets the surface at `distance` (m). Whether anything is between them is not asked.
    pub fn pdf(&self, p: Vec3, wi: Vec3, distance: f32) -> f32 {
        let by_area = || distance * distance / (self.normal.dot(wi).abs().max(1e-9) * self.area);
        match &self.shape {
            AreaShape::Triangle(_) => by_area(),
            AreaShape::Parallelogram(_) => match self.rectangle.and_then(|r| r.seen_from(p, self.area)) {
                Some(rectangle) => 1.0 / rectangle.solid_angle,
                None => by_area(),
            },
            // The far side, of a sphere that lets rays in, is not sampled: it lies beyond where rays touch the sphere.
            AreaShape::Sphere(s) => match cone_of_sphere(s, p) {
                Some((sin2, one_minus_cos)) if distance * distance * sin2 <= s.radius * s.radius * (1.0 - sin2) * 1.0001 => {
                    1.0 / (TAU * one_minus_cos)
                }
                _ => 0.0,
            },
        }
    }
}

/// Weights of the second and third corner, uniform by area; keeps strata (Heitz 2019, "A Low-Distortion Map Between Triangle and Square").
fn triangle_place(u: [f32; 2]) -> Vec2 {
    if u[1] > u[0] { Vec2::new(0.5 * u[0], u[1] - 0.5 * u[0]) } else { Vec2::new(u[0] - 0.5 * u[1], 0.5 * u[1]) }
}

/// sin² and 1 − cos of the half angle under which a sphere is seen; `None` from inside.
fn cone_of_sphere(sphere: &Sphere, p: Vec3) -> Option<(f32, f32)> {
    let sin2 = sphere.radius * sphere.radius / (sphere.center - p).length_squared();
    // From inside, or from the sphere's own surface, which rounding puts on either side.
    if sin2 >= 0.9999 {
        return None;
    }
    // 1 − √(1 − s) without cancellation.
    Some((sin2, sin2 / (1.0 + (1.0 - sin2).sqrt())))
}

fn sample_li_sphere(sphere: &Sphere, p: Vec3, u: [f32; 2], number: u32) -> Option<LightSample> {
    let (_, one_minus_cos_max) = cone_of_sphere(sphere, p)?;
    let axis = (sphere.center - p).normalize();
    let one_minus_cos = u[0] * one_minus_cos_max;
    let cos = 1.0 - one_minus_cos;
    let sin = (one_minus_cos * (2.0 - one_minus_cos)).max(0.0).sqrt();
    let (x, y) = sampling::frame(axis);
    let wi = (x * (sin * (TAU * u[1]).cos()) + y * (sin * (TAU * u[1]).sin()) + axis * cos).normalize();
    // Rounding can make the ray just miss: then the nearest point stands for the hit.
    let distance = sphere.intersect(p, wi, f32::INFINITY).unwrap_or_else(|| (sphere.center - p).dot(wi));
    let pdf = 1.0 / (TAU * one_minus_cos_max);
    let end = p + wi * distance;
    let cos = (end - sphere.center).dot(wi) / sphere.radius;
    let clearance = clearance(p, end, distance, cos);
    Some(LightSample { wi, distance, pdf, has_extent: true, spot: LightPoint::Area(number, Vec2::ZERO), clearance })
}

/// Area over squared distance (sr) below which rectangles are sampled by area.
const SMALL_SOLID_ANGLE: f32 = 0.25;

/// Distance from a plane that rounding makes, as a fraction of the coordinates.
const IN_PLANE: f32 = 1e-6;

/// A rectangle: unit vectors along its edges, the one square to both, and the lengths of the edges, m.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    corner: Vec3,
    middle: Vec3,
    axes: [Vec3; 3],
    lengths: Vec2,
}

/// A rectangle seen from a point, ready to be sampled uniformly in solid angle.
struct SphericalRectangle {
    x0: f32,
    y0: f32,
    y1: f32,
    z0: f32,
    b0: f32,
    b1: f32,
    k: f32,
    solid_angle: f32,
    lengths: Vec2,
    x1: f32,
}

impl Rectangle {
    /// `None` for skewed parallelograms.
    fn of(quad: &Quad) -> Option<Self> {
        let lengths = Vec2::new(quad.edges[0].length(), quad.edges[1].length());
        let (ex, ey) = (quad.edges[0] / lengths.x, quad.edges[1] / lengths.y);
        let middle = quad.point(Vec2::splat(0.5));
        (ex.dot(ey).abs() <= 1e-4).then(|| Rectangle { corner: quad.corner, middle, axes: [ex, ey, ex.cross(ey)], lengths })
    }

    /// The rectangle as a point sees it. `area`: its own, m². `None` from points in its plane, and where it is so small that area sampling is as good.
    fn seen_from(&self, p: Vec3, area: f32) -> Option<SphericalRectangle> {
        // Small or far: the solid angle of all places is nearly the same (and rounding would show in the sum of angles).
        if (self.middle - p).length_squared() * SMALL_SOLID_ANGLE > area {
            return None;
        }
        let (lengths, [ex, ey, ez]) = (self.lengths, self.axes);
        let d = self.corner - p;
        let z = d.dot(ez);
        // In the plane, as near as rounding lets one tell: half of all directions would be those of the rectangle, and its back would be lit.
        if z.abs() <= IN_PLANE * (lengths.x + lengths.y + d.abs().max_element() + p.abs().max_element()) {
            return None;
        }
        let z0 = -z.abs();
        let (x0, y0) = (d.dot(ex), d.dot(ey));
        let (x1, y1) = (x0 + lengths.x, y0 + lengths.y);
        // Normals of the four planes through the point and an edge, as far as needed.
        let across = Vec4::new(-y0, x1, y1, -x0);
        let n = across / square_roots(across * across + z0 * z0);
        let [g0, g1, g2, g3] = arccosines(-(n * n.yzwx())).to_array();
        let solid_angle = g0 + g1 + g2 + g3 - TAU;
        // Seen nearly edge-on.
        if !(solid_angle > 3e-3) {
            return None;
        }
        Some(SphericalRectangle { x0, y0, y1, z0, b0: n.x, b1: n.z, k: TAU - g2 - g3, solid_angle, lengths, x1 })
    }
}

impl SphericalRectangle {
    /// (α, β) of the rectangle.
    fn sample(&self, u: [f32; 2]) -> Vec2 {
        let au = u[0] * self.solid_angle + self.k;
        let fu = (au.cos() * self.b0 - self.b1) / au.sin();
        let cu = ((1.0 / (fu * fu + self.b0 * self.b0).sqrt()).copysign(fu)).clamp(-1.0, 1.0);
        let xu = (-(cu * self.z0) / (1.0 - cu * cu).max(1e-12).sqrt()).clamp(self.x0, self.x1);
        let d2 = xu * xu + self.z0 * self.z0;
        let h0 = self.y0 / (d2 + self.y0 * self.y0).sqrt();
        let h1 = self.y1 / (d2 + self.y1 * self.y1).sqrt();
        let hv = h0 + u[1] * (h1 - h0);
        let yv = if hv * hv < 1.0 - 1e-6 { hv * d2.sqrt() / (1.0 - hv * hv).sqrt() } else { self.y1 };
        Vec2::new((xu - self.x0) / self.lengths.x, (yv - self.y0) / self.lengths.y).clamp(Vec2::ZERO, Vec2::ONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Coverage;
    use crate::texture::Scalar;
    use diopter_light::random::{mix, to_unit};

    fn light(shape: AreaShape) -> AreaLight {
        AreaLight::new(shape, 0, Default::default(), false, 1.0)
    }

    /// Irradiance on a plane through the origin with normal +z, from a light of radiance 1: mean of cos θ / pdf.
    fn irradiance(light: &AreaLight, n: u32) -> f64 {
        let mut sum = 0.0;
        for i in 0..n * n {
            let u = [(i % n) as f32 + to_unit(mix(i)), (i / n) as f32 + to_unit(mix(i ^ 0xffff))].map(|x| x / n as f32);
            if let Some(light_sample) = light.sample_li(Vec3::ZERO, u, 0) {
                let check = light.pdf(Vec3::ZERO, light_sample.wi, light_sample.distance);
                assert!((check / light_sample.pdf - 1.0).abs() < 2e-3, "{check} {}", light_sample.pdf);
                sum += (light_sample.wi.z.max(0.0) / light_sample.pdf) as f64;
            }
        }
        sum / (n * n) as f64
    }

    /// ∫ cos cos' / d² dA of a parallelogram facing down, by midpoints.
    fn form_factor(q: &Quad, triangle: bool) -> f64 {
        let n = 600;
        let mut sum = 0.0;
        for i in 0..n * n {
            let place = Vec2::new(((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
            if triangle && place.x + place.y > 1.0 {
                continue;
            }
            let p = q.point(place);
            let d2 = p.length_squared();
            let w = p / d2.sqrt();
            sum += (w.z * -q.normal().dot(w) / d2) as f64;
        }
        sum * q.area() as f64 / (n * n) as f64
    }

    #[test]
    fn every_shape_gives_its_form_factor() {
        let rectangle = Quad { corner: Vec3::new(-0.3, -0.5, 1.0), edges: [Vec3::new(0.0, 1.2, 0.0), Vec3::new(1.0, 0.0, 0.0)] };
        let skew = Quad { corner: Vec3::new(0.1, -0.2, 0.7), edges: [Vec3::new(0.3, 0.9, 0.1), Vec3::new(0.8, 0.1, 0.2)] };
        for shape in [AreaShape::Parallelogram(rectangle), AreaShape::Parallelogram(skew), AreaShape::Triangle(rectangle)] {
            let (quad, triangle) = match shape {
                AreaShape::Triangle(q) => (q, true),
                AreaShape::Parallelogram(q) => (q, false),
                AreaShape::Sphere(_) => unreachable!(),
            };
            let exact = form_factor(&quad, triangle);
            let got = irradiance(&light(shape), 200);
            assert!((got / exact - 1.0).abs() < 5e-3, "{shape:?}: {got} {exact}");
        }
        // A sphere straight above: E = π L sin²θ.
        let sphere = Sphere { center: Vec3::new(0.0, 0.0, 2.0), radius: 0.5 };
        let got = irradiance(&light(AreaShape::Sphere(sphere)), 200);
        assert!((got / (std::f64::consts::PI / 16.0) - 1.0).abs() < 2e-3, "{got}");
    }

    #[test]
    fn no_place_of_a_rectangle_is_lit_by_it() {
        // Places of tilted rectangles, as rounding leaves them on either side of the plane.
        for i in 0..400u32 {
            let random = |k: u32| Vec3::from_array(std::array::from_fn(|a| 2.0 * to_unit(mix(i * 64 + k * 3 + a as u32)) - 1.0));
            let ex = random(0).normalize();
            let ey = ex.cross(random(1)).normalize() * 1.5;
            let quad = Quad { corner: random(2) * 3.0, edges: [ex, ey] };
            let lamp = light(AreaShape::Parallelogram(quad));
            let place = |k: u32| Vec2::new(to_unit(mix(i * 7 + k)), to_unit(mix(i * 11 + k + 99)));
            let p = quad.point(place(0));
            // What a white surface there would get from it.
            let lit = (0..64).filter_map(|k| lamp.sample_li(p, place(k + 1).to_array(), 0));
            let got: f32 = lit.map(|s| s.wi.dot(quad.normal()).abs() / s.pdf).sum::<f32>() / 64.0;
            assert!(got < 1e-3, "{i}: {got}");
        }
    }

    #[test]
    fn a_lamp_shines_as_often_as_rays_meet_it() {
        // Coverage by a number and by the alpha of the corners: what is sampled is the mean of what is hit.
        let q = Quad { corner: Vec3::new(-1.0, -1.0, 1.0), edges: [Vec3::X * 2.0, Vec3::Y * 2.0] };
        let alpha = [1.0, 0.2, 0.6];
        let lamp = light(AreaShape::Triangle(q)).with_alpha(alpha);
        let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let half = || Scalar::Constant(0.5);
        for coverage in [Coverage::Full, Coverage::Blend(half()), Coverage::Mask { alpha: half(), cutoff: 0.3 }] {
            let material = Material { coverage, ..Material::lamp("lamp", Spectrum::Constant(1.0)) };
            let full = Material::lamp("lamp", Spectrum::Constant(1.0));
            for place in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::splat(0.25)] {
                let vertex = alpha[0] * (1.0 - place.x - place.y) + alpha[1] * place.x + alpha[2] * place.y;
                let n = 1000;
                let hits = (0..n).filter(|i| material.coverage.accepts(&[Vec2::ZERO; 2], vertex, (*i as f32 + 0.5) / n as f32));
                let met = hits.count() as f32 / n as f32;
                let whole = lamp.radiance(place, std::slice::from_ref(&full), &wavelengths);
                let part = lamp.radiance(place, std::slice::from_ref(&material), &wavelengths);
                assert!((part - whole * met).abs().max_element() < 2e-3 * whole.max_element(), "{part} {whole} {met}");
            }
        }
    }

    #[test]
    fn balls_and_quads_with_holes_shine_less() {
        let q = Quad { corner: Vec3::new(-1.0, -1.0, 1.0), edges: [Vec3::X * 2.0, Vec3::Y * 2.0] };
        let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let full = Material::lamp("lamp", Spectrum::Constant(1.0));
        let half = Material { coverage: Coverage::Blend(Scalar::Constant(0.5)), ..full.clone() };
        let sphere = Sphere { center: Vec3::new(0.0, 0.0, 5.0), radius: 3.0 };
        for shape in [AreaShape::Parallelogram(q), AreaShape::Sphere(sphere)] {
            let lamp = light(shape);
            let [whole, part] = [&full, &half].map(|m| lamp.radiance(Vec2::splat(0.5), std::slice::from_ref(m), &wavelengths));
            assert_eq!(part, whole * 0.5);
        }
        // Rays that come in through a hole meet the far side, at which no light sample aims.
        let ball = light(AreaShape::Sphere(sphere));
        assert!(ball.pdf(Vec3::ZERO, Vec3::Z, 2.0) > 0.0 && ball.pdf(Vec3::ZERO, Vec3::Z, 8.0) == 0.0);
        let edge = ball.sample_li(Vec3::ZERO, [0.999_999, 0.3], 0).unwrap();
        assert_eq!(ball.pdf(Vec3::ZERO, edge.wi, edge.distance), edge.pdf);
    }

    #[test]
    fn the_back_of_a_lamp_is_not_aimed_at() {
        let q = Quad { corner: Vec3::new(-1.0, -1.0, 1.0), edges: [Vec3::X * 2.0, Vec3::Y * 2.0] };
        assert!(light(AreaShape::Parallelogram(q)).sample_li(Vec3::ZERO, [0.5, 0.5], 0).is_none());
        let both = AreaLight { two_sided: true, ..light(AreaShape::Parallelogram(q)) };
        assert!(both.sample_li(Vec3::ZERO, [0.5, 0.5], 0).is_some());
    }
}
