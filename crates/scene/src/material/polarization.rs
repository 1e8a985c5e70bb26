//! What surfaces do to the polarisation of light: Fresnel's amplitudes, and the Mueller matrices of scattering events.
//!
//! Conventions: those of [`diopter_light::polarization`]. At an interface the frame of light has its x axis along s, perpendicular to the plane of incidence, on
//! both sides; y is p = k × s. Amplitudes are those of Born & Wolf §1.5.2 (r∥ is positive where r⊥ is negative at normal incidence, since p turns over with the light),
//! complex indices n + ik go with exp(−iωt) (§14.1 there writes n(1 + iκ)). Within one plane of incidence an event is diagonal in s and p
//! (`InPlane`); what goes to and fro between parallel faces without interference adds up there element by element. Elsewhere matrices are whole (`Event`).
//!
//! What is not followed: light that bounces between facets of a rough surface (what energy compensation gives back) and light that comes out of a diffuse
//! base are unpolarised, the latter but for its way through the interface; fibres, cloth, hair and measured tables depolarise.

use diopter_light::SampledSpectrum;
use diopter_light::polarization::{DEPOLARIZER, Mueller, a_from_b};
use glam::{Mat4, Vec3, Vec4};

/// Complex numbers at four wavelengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Complex {
    pub re: SampledSpectrum,
    pub im: SampledSpectrum,
}

impl Complex {
    pub const ONE: Complex = Complex::real(SampledSpectrum::ONE);

    /// A real number at each wavelength.
    pub const fn real(re: SampledSpectrum) -> Self {
        Complex { re, im: SampledSpectrum::ZERO }
    }

    /// The same real number at all wavelengths.
    pub fn splat(re: f32) -> Self {
        Complex::real(SampledSpectrum::splat(re))
    }

    /// The complex conjugate.
    pub fn conj(self) -> Self {
        Complex { re: self.re, im: -self.im }
    }

    /// The squared magnitude.
    pub fn norm2(self) -> SampledSpectrum {
        self.re * self.re + self.im * self.im
    }

    /// The number times a real factor.
    pub fn scaled(self, factor: SampledSpectrum) -> Self {
        Complex { re: self.re * factor, im: self.im * factor }
    }

    /// exp(i phase).
    pub fn turn(phase: SampledSpectrum) -> Self {
        let [re, im] = [f32::cos, f32::sin].map(|f| SampledSpectrum::from_array(phase.to_array().map(f)));
        Complex { re, im }
    }

    /// The root whose imaginary part is not negative: waves that decay along their way.
    pub fn sqrt(self) -> Self {
        let length = roots(self.norm2());
        let re = roots((length + self.re) * 0.5);
        let im = roots((length - self.re) * 0.5);
        let sign = SampledSpectrum::select(self.im.cmplt(SampledSpectrum::ZERO), SampledSpectrum::NEG_ONE, SampledSpectrum::ONE);
        Complex { re: re * sign, im }
    }
}

fn roots(v: SampledSpectrum) -> SampledSpectrum {
    SampledSpectrum::from_array(v.max(SampledSpectrum::ZERO).to_array().map(f32::sqrt))
}

impl std::ops::Add for Complex {
    type Output = Complex;
    fn add(self, o: Complex) -> Complex {
        Complex { re: self.re + o.re, im: self.im + o.im }
    }
}

impl std::ops::Sub for Complex {
    type Output = Complex;
    fn sub(self, o: Complex) -> Complex {
        Complex { re: self.re - o.re, im: self.im - o.im }
    }
}

impl std::ops::Mul for Complex {
    type Output = Complex;
    fn mul(self, o: Complex) -> Complex {
        Complex { re: self.re * o.re - self.im * o.im, im: self.re * o.im + self.im * o.re }
    }
}

impl std::ops::Div for Complex {
    type Output = Complex;
    /// 0 where the divisor is 0.
    fn div(self, o: Complex) -> Complex {
        let n = o.norm2();
        let inverse = SampledSpectrum::select(n.cmpgt(SampledSpectrum::ZERO), SampledSpectrum::ONE / n, SampledSpectrum::ZERO);
        (self * o.conj()).scaled(inverse)
    }
}

/// An event within one plane of incidence: fractions of the power along s and p, and what the product Es Ep* is multiplied by.
///
/// Its Mueller matrix is [[a, b, 0, 0], [b, a, 0, 0], [0, 0, Re z, −Im z], [0, 0, Im z, Re z]], a and b half of the sum and of the difference of s and p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InPlane {
    pub s: SampledSpectrum,
    pub p: SampledSpectrum,
    pub z: Complex,
}

impl InPlane {
    pub const NOTHING: InPlane =
        InPlane { s: SampledSpectrum::ZERO, p: SampledSpectrum::ZERO, z: Complex::real(SampledSpectrum::ZERO) };

    /// What amplitudes of s and p do to intensities and to the phase between them.
    pub fn of([s, p]: [Complex; 2]) -> Self {
        InPlane { s: s.norm2(), p: p.norm2(), z: s * p.conj() }
    }

    /// Factor on unpolarised light.
    pub fn mean(&self) -> SampledSpectrum {
        (self.s + self.p) * 0.5
    }

    /// All of it times a factor.
    pub fn scaled(self, factor: SampledSpectrum) -> Self {
        InPlane { s: self.s * factor, p: self.p * factor, z: self.z.scaled(factor) }
    }

    /// The same for a factor of 1 on unpolarised light; nothing where that is 0.
    pub fn normalized(self) -> Self {
        let mean = self.mean();
        self.scaled(SampledSpectrum::select(
            mean.cmpgt(SampledSpectrum::ZERO),
            SampledSpectrum::ONE / mean,
            SampledSpectrum::ZERO,
        ))
    }

    /// The same of which only a fraction of the difference of s and p is left.
    pub fn fraction_of_difference(self, fraction: f32) -> Self {
        let mean = self.mean();
        InPlane { s: mean + (self.s - mean) * fraction, p: mean + (self.p - mean) * fraction, z: self.z }
    }

    /// This event after or before another in the same plane.
    pub fn times(self, o: InPlane) -> Self {
        InPlane { s: self.s * o.s, p: self.p * o.p, z: self.z * o.z }
    }

    /// Both beside each other, without interference.
    pub fn plus(self, o: InPlane) -> Self {
        InPlane { s: self.s + o.s, p: self.p + o.p, z: self.z + o.z }
    }

    /// first + first · turn + first · turn² + …: what goes to and fro.
    pub fn again_and_again(self, turn: InPlane) -> Self {
        let rest = |x: SampledSpectrum| SampledSpectrum::ONE / (SampledSpectrum::ONE - x).max(SampledSpectrum::splat(1e-6));
        InPlane { s: self.s * rest(turn.s), p: self.p * rest(turn.p), z: self.z / (Complex::ONE - turn.z) }
    }

    /// Its Mueller matrix at a wavelength, frames along s.
    pub fn matrix(&self, lane: usize) -> Mueller {
        let (a, b) = (0.5 * (self.s[lane] + self.p[lane]), 0.5 * (self.s[lane] - self.p[lane]));
        let (re, im) = (self.z.re[lane], self.z.im[lane]);
        Mat4::from_cols(
            Vec4::new(a, b, 0.0, 0.0),
            Vec4::new(b, a, 0.0, 0.0),
            Vec4::new(0.0, 0.0, re, im),
            Vec4::new(0.0, 0.0, -im, re),
        )
    }
}

/// Amplitudes that a plane interface reflects at a cosine on the side that light comes from; `n`: complex index beyond over that before.
/// Source: Born & Wolf 1.5.2 eq. 21, and 1.5.4 for total reflection.
fn reflected(cos_i: f32, n: Complex) -> [Complex; 2] {
    let c = Complex::splat(cos_i.abs().min(1.0));
    let sin2 = Complex::splat((1.0 - cos_i * cos_i).max(0.0));
    // n cos θ beyond; decaying waves have a positive imaginary part.
    let n2 = n * n;
    let beyond = (n2 - sin2).sqrt();
    [(c - beyond) / (c + beyond), (n2 * c - beyond) / (n2 * c + beyond)]
}

/// What a smooth dielectric interface reflects and transmits; `eta` = n beyond / n before, at a cosine before.
pub(crate) fn dielectric(cos_i: f32, eta: f32) -> [InPlane; 2] {
    let reflection = InPlane::of(reflected(cos_i, Complex::splat(eta)));
    let (s, p) = (SampledSpectrum::ONE - reflection.s, SampledSpectrum::ONE - reflection.p);
    // Both amplitudes are real and positive where there is any transmission.
    let z = Complex::real(roots(s.max(SampledSpectrum::ZERO) * p.max(SampledSpectrum::ZERO)));
    [reflection, InPlane { s: s.max(SampledSpectrum::ZERO), p: p.max(SampledSpectrum::ZERO), z }]
}

/// What a metal of index n + ik, relative to what is before it, reflects.
pub(crate) fn conductor(cos_i: f32, n: SampledSpectrum, k: SampledSpectrum) -> InPlane {
    InPlane::of(reflected(cos_i, Complex { re: n, im: k }))
}

/// What a film reflects and transmits between air and a base: its index and optical phase 4π n d cos θ / λ there and back; `cos` outside.
/// Source: Born & Wolf 1.6.4 eq. 57, 58.
pub(crate) fn film(cos: f32, index: f32, base: SampledSpectrum, phase: SampledSpectrum) -> [InPlane; 2] {
    let cos = cos.abs().clamp(1e-4, 1.0);
    let sin2 = 1.0 - cos * cos;
    let within = (1.0 - sin2 / (index * index)).max(0.0).sqrt();
    let beyond = roots(SampledSpectrum::ONE - SampledSpectrum::splat(sin2) / (base * base));
    let (c, w) = (SampledSpectrum::splat(cos), SampledSpectrum::splat(within));
    let n = SampledSpectrum::splat(index);
    let turn = Complex::turn(phase);
    let amplitudes = |upper: SampledSpectrum, lower: SampledSpectrum, through: SampledSpectrum| {
        let lower = turn.scaled(lower);
        let sum = Complex::ONE + lower.scaled(upper);
        // The phase of one way through the film is the same for s and p.
        [(Complex::real(upper) + lower) / sum, Complex::real(through) / sum]
    };
    let ratio = |a: SampledSpectrum, b: SampledSpectrum| {
        let sum = a + b;
        SampledSpectrum::select(sum.cmpgt(SampledSpectrum::ZERO), (a - b) / sum, SampledSpectrum::NEG_ONE)
    };
    let [s0, s1] = [ratio(c, n * w), ratio(n * w, base * beyond)];
    let [p0, p1] = [ratio(n * c, w), ratio(base * w, n * beyond)];
    let through = |a: SampledSpectrum, b: SampledSpectrum| roots((SampledSpectrum::ONE - a * a) * (SampledSpectrum::ONE - b * b));
    let [rs, ts] = amplitudes(s0, s1, through(s0, s1));
    let [rp, tp] = amplitudes(p0, p1, through(p0, p1));
    [InPlane::of([rs, rp]), InPlane::of([ts, tp])]
}

/// A thin dielectric, or any two parallel equal faces without interference: what it reflects and transmits, by what one face does.
pub(crate) fn thin_dielectric_faces([r, t]: [InPlane; 2]) -> [InPlane; 2] {
    let back = r.times(r);
    [r.plus(t.times(t).times(r).again_and_again(back)), t.times(t).again_and_again(back)]
}

/// A scattering event as a Mueller matrix at each of four wavelengths, over what the event does to unpolarised light that is detected whatever its polarisation:
/// where models are exact, its first element is 1.
#[derive(Clone, Copy, Debug)]
pub struct Event {
    /// x axis of the light that leaves, towards the camera; world space.
    pub outgoing: Vec3,
    /// x axis of the light that arrives.
    pub incoming: Vec3,
    /// The matrices.
    pub matrices: [Mueller; 4],
}

impl Event {
    /// Nothing of the polarisation is kept, and light leaves unpolarised.
    pub const DEPOLARIZES: Event = Event { outgoing: Vec3::X, incoming: Vec3::X, matrices: [DEPOLARIZER; 4] };

    /// No light.
    pub(crate) const NOTHING: Event = Event { outgoing: Vec3::X, incoming: Vec3::X, matrices: [Mat4::ZERO; 4] };

    /// Of what happens in one plane of incidence, s being its normal.
    pub(crate) fn in_plane(s: Vec3, event: &InPlane) -> Event {
        Event { outgoing: s, incoming: s, matrices: std::array::from_fn(|lane| event.matrix(lane)) }
    }

    /// The same beside light of which nothing of the polarisation is kept.
    pub(crate) fn mixed(s: Vec3, event: &InPlane, depolarized: SampledSpectrum) -> Event {
        let matrix = |lane: usize| event.matrix(lane) + DEPOLARIZER * depolarized[lane];
        Event { outgoing: s, incoming: s, matrices: std::array::from_fn(matrix) }
    }

    /// Its matrices times factors.
    pub(crate) fn scaled(self, factor: SampledSpectrum) -> Event {
        Event { matrices: std::array::from_fn(|lane| self.matrices[lane] * factor[lane]), ..self }
    }

    /// Its matrices over what they are on the whole; where that is nothing, nothing of the polarisation is kept.
    pub(crate) fn over(self, all: SampledSpectrum) -> Event {
        let matrix = |lane: usize| if all[lane] > 0.0 { self.matrices[lane] * (1.0 / all[lane]) } else { DEPOLARIZER };
        Event { matrices: std::array::from_fn(matrix), ..self }
    }

    /// The same in frames whose x axis is `s` on both sides; `wo`: the direction in which light leaves, `wi` that from which it comes.
    pub(crate) fn in_frames_of(&self, s: Vec3, wo: Vec3, wi: Vec3) -> Event {
        let (out, back) = (a_from_b(s, self.outgoing, wo), a_from_b(self.incoming, s, -wi));
        Event { outgoing: s, incoming: s, matrices: self.matrices.map(|m| out * m * back) }
    }

    /// This event, whose frames are along `s`, beside another one of any frames.
    pub(crate) fn plus(self, other: &Event, s: Vec3, wo: Vec3, wi: Vec3) -> Event {
        let other = other.in_frames_of(s, wo, wi);
        Event { outgoing: s, incoming: s, matrices: std::array::from_fn(|lane| self.matrices[lane] + other.matrices[lane]) }
    }

    /// The same in the world, of one in a local frame of these axes.
    pub(crate) fn placed(self, [x, y, z]: [Vec3; 3]) -> Event {
        let world = |v: Vec3| x * v.x + y * v.y + z * v.z;
        Event { outgoing: world(self.outgoing), incoming: world(self.incoming), ..self }
    }

    /// What a path that ends here does, and, farther from the camera, what `farther` does; `k`: the direction of light between both.
    pub fn then(&self, farther: &Event, k: Vec3) -> Event {
        let turn = a_from_b(self.incoming, farther.outgoing, k);
        let matrices = std::array::from_fn(|lane| self.matrices[lane] * turn * farther.matrices[lane]);
        Event { outgoing: self.outgoing, incoming: farther.incoming, matrices }
    }
}

/// An axis perpendicular to a direction and to a normal: s of the plane of incidence; any where both are along each other.
pub(crate) fn s_axis(normal: Vec3, direction: Vec3) -> Vec3 {
    normal.cross(direction).try_normalize().unwrap_or_else(|| diopter_light::sampling::frame(direction).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::microfacet::{fresnel_conductor, fresnel_dielectric};
    use diopter_light::polarization::degree_of_linear_polarization;
    use std::f32::consts::{FRAC_PI_4, PI};

    #[test]
    fn means_are_those_of_unpolarised_light() {
        for cos in [1.0, 0.9, 0.5, 0.2, 0.02f32] {
            for eta in [1.33, 1.5, 2.4, 1.0 / 1.33, 1.0 / 1.5f32] {
                let [r, t] = dielectric(cos, eta);
                let expected = fresnel_dielectric(cos, eta);
                assert!((r.mean().x - expected).abs() < 2e-5, "{cos} {eta}: {} {expected}", r.mean().x);
                assert!((r.mean() + t.mean() - SampledSpectrum::ONE).abs().max_element() < 1e-6);
            }
            let (n, k) = (SampledSpectrum::new(0.13, 0.27, 1.2, 2.9), SampledSpectrum::new(3.99, 2.8, 7.26, 3.05));
            let difference = conductor(cos, n, k).mean() - fresnel_conductor(cos, n, k);
            assert!(difference.abs().max_element() < 2e-4, "{cos}: {difference}");
        }
    }

    #[test]
    fn at_brewsters_angle_only_s_is_reflected() {
        for n in [1.333, 1.5, 2.0f32] {
            let angle = n.atan();
            let [r, t] = dielectric(angle.cos(), n);
            let light = r.matrix(0) * Vec4::X;
            assert!(degree_of_linear_polarization(light) > 1.0 - 1e-5 && light.y > 0.0, "{n}: {light}");
            // ((n² − 1) / (n² + 1))² of s (Born & Wolf 1.5.3).
            assert!((r.s.x - ((n * n - 1.0) / (n * n + 1.0)).powi(2)).abs() < 1e-6);
            // Below and above it, light at 45° comes back on different sides: r∥ changes its sign.
            let diagonal = Vec4::new(1.0, 0.0, 1.0, 0.0);
            let [below, above] = [-0.1, 0.1].map(|d: f32| dielectric((angle + d).cos(), n)[0].matrix(0) * diagonal);
            assert!(below.z < 0.0 && above.z > 0.0, "{below} {above}");
            // What is transmitted has the rest.
            assert!((light + t.matrix(0) * Vec4::X - Vec4::X).abs().max_element() < 1e-6);
        }
    }

    #[test]
    fn fresnels_rhomb_makes_circular_light_by_two_total_reflections() {
        // Born & Wolf 1.5.4: n = 1.51, a phase of 45° between the components at 48°37' and 54°37'.
        for degrees in [48.0 + 37.0 / 60.0, 54.0 + 37.0 / 60.0f32] {
            let [r, t] = dielectric(degrees.to_radians().cos(), 1.0 / 1.51);
            assert!((r.s.x - 1.0).abs() < 1e-5 && (r.p.x - 1.0).abs() < 1e-5 && t.mean().x < 1e-5);
            let phase = r.z.im.x.atan2(r.z.re.x);
            // s is behind p by π − 45° … in frames that turn over with the light by 45° of the phase of r∥ / r⊥: tan(δ/2) = cos θ √(sin²θ − n²) / sin²θ.
            let (sin2, cos, n) = (degrees.to_radians().sin().powi(2), degrees.to_radians().cos(), 1.0 / 1.51f32);
            let expected = 2.0 * (cos * (sin2 - n * n).sqrt() / sin2).atan();
            assert!(
                (phase.abs() - expected).abs() < 1e-4 && (expected - FRAC_PI_4).abs() < 2e-3,
                "{degrees}: {phase} {expected}"
            );
            let diagonal = Vec4::new(1.0, 0.0, 1.0, 0.0);
            let light = r.matrix(0) * (r.matrix(0) * diagonal);
            assert!((light.w.abs() - 1.0).abs() < 5e-3 && degree_of_linear_polarization(light) < 0.01, "{light}");
        }
    }

    #[test]
    fn a_mirror_turns_right_handed_light_into_left_handed() {
        let r = conductor(1.0, SampledSpectrum::splat(0.1), SampledSpectrum::splat(4.0));
        let light = r.matrix(0) * Vec4::new(1.0, 0.0, 0.0, 1.0);
        assert!((light.w + light.x).abs() < 1e-6 && light.x > 0.9);
        // Metals delay one component: at 70° aluminium makes elliptical light of linear light at 45°.
        let r = conductor(70f32.to_radians().cos(), SampledSpectrum::splat(1.2), SampledSpectrum::splat(7.26));
        let light = r.matrix(0) * Vec4::new(1.0, 0.0, 1.0, 0.0);
        assert!(light.w.abs() > 0.1, "{light}");
        assert!(
            (light.x.powi(2) - light.truncate().with_x(0.0).length_squared() - light.w.powi(2)).abs() < 1e-4,
            "stays fully polarised: {light}"
        );
    }

    #[test]
    fn a_principal_angle_is_where_a_metal_delays_by_a_quarter_wave() {
        // Born & Wolf 14.2: at the principal angle of incidence the phases differ by 90°; n² + k² large: sin θ tan θ ≈ √(n² + k²).
        let (n, k) = (1.2f32, 7.26f32);
        let phase = |angle: f32| {
            let z = conductor(angle.cos(), SampledSpectrum::splat(n), SampledSpectrum::splat(k)).z;
            z.im.x.atan2(z.re.x).abs()
        };
        let (mut low, mut high) = (0.8f32, 1.55f32);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if phase(middle) > PI / 2.0 { low = middle } else { high = middle }
        }
        let product = low.sin() * low.tan();
        assert!((product / n.hypot(k) - 1.0).abs() < 0.02, "{product}");
    }

    #[test]
    fn films_without_thickness_are_the_bare_interface_and_lose_nothing() {
        for cos in [1.0, 0.7, 0.3f32] {
            let bare = dielectric(cos, 1.5);
            let none = film(cos, 1.38, SampledSpectrum::splat(1.5), SampledSpectrum::ZERO);
            for (a, b) in bare.iter().zip(&none) {
                assert!((a.s - b.s).abs().max_element() < 1e-5 && (a.p - b.p).abs().max_element() < 1e-5, "{cos}: {a:?} {b:?}");
                assert!((a.z.re - b.z.re).abs().max_element() < 1e-5 && b.z.im.abs().max_element() < 1e-5, "{cos}: {a:?} {b:?}");
            }
            let [r, t] = film(cos, 1.38, SampledSpectrum::splat(1.5), SampledSpectrum::new(0.5, 1.5, 3.0, 6.0));
            assert!(
                (r.s + t.s - SampledSpectrum::ONE).abs().max_element() < 1e-5
                    && (r.p + t.p - SampledSpectrum::ONE).abs().max_element() < 1e-5
            );
            // Fully polarised light stays so: |z|² = s p.
            assert!((r.z.norm2() - r.s * r.p).abs().max_element() < 1e-6 && (t.z.norm2() - t.s * t.p).abs().max_element() < 1e-5);
        }
    }

    #[test]
    fn a_pane_reflects_each_component_by_both_faces() {
        let (cos, n) = (0.5f32, 1.5f32);
        let one = dielectric(cos, n);
        let [r, t] = thin_dielectric_faces(one);
        // 2 R / (1 + R) of each component; nothing is lost.
        assert!((r.s.x - 2.0 * one[0].s.x / (1.0 + one[0].s.x)).abs() < 1e-6);
        assert!((r.p.x - 2.0 * one[0].p.x / (1.0 + one[0].p.x)).abs() < 1e-6);
        assert!(
            (r.s + t.s - SampledSpectrum::ONE).abs().max_element() < 1e-6
                && (r.p + t.p - SampledSpectrum::ONE).abs().max_element() < 1e-6
        );
    }

    #[test]
    fn events_join_in_any_frame() {
        // The same two reflections, the second in a turned plane: whatever the axis is called, and by matrices of the textbook.
        let k = Vec3::Z;
        let (angle, s1) = (0.7f32, Vec3::X);
        let s2 = Vec3::new(angle.cos(), angle.sin(), 0.0);
        let [r, _] = dielectric(1.5f32.atan().cos(), 1.5);
        let [near, far] = [s1, s2].map(|s| Event::in_plane(s, &r.normalized()));
        let both = near.then(&far, k);
        let light = both.matrices[1] * Vec4::X;
        // Two plates at Brewster's angle are polariser and analyser: 2 cos² between their planes, 1 where they are at 45°.
        assert!((light.x - 2.0 * angle.cos().powi(2)).abs() < 1e-4, "{light}");
        let crossed = near.then(&Event::in_plane(Vec3::Y, &r.normalized()), k).matrices[0] * Vec4::X;
        assert!(crossed.x.abs() < 1e-4, "{crossed}");
    }
}
