//! What may differ from the design, and the lens that comes of it.

use super::passes::Passes;
use crate::glass::{C_NM, D_NM, F_NM, G_NM, Glass, GlassError, GlassKind};
use crate::prescription::{Misalignment, Prescription};
use crate::surface::Profile;

/// Wavelength of fringes, nm: the mercury e line (ISO 10110-5).
pub const FRINGE_NM: f64 = 546.07;

/// x or y.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Across the fields.
    X,
    /// In their plane.
    Y,
}

/// One way to be wrong. Surfaces are counted from 0 here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Change {
    /// Radius of curvature, mm.
    Radius {
        /// Which surface.
        surface: usize,
    },
    /// Curvature, 1/mm: what fringes of power are.
    Curvature {
        /// Which surface.
        surface: usize,
    },
    /// Astigmatism of the form, fringes from peak to valley: along the axes (x), and at 45° to them (y).
    Irregularity {
        /// Which surface.
        surface: usize,
        /// Which of the two.
        axis: Axis,
    },
    /// The gap after a surface, mm.
    Gap {
        /// Which surface.
        surface: usize,
    },
    /// The index of what follows a surface, the same at all wavelengths.
    Index {
        /// Which surface.
        surface: usize,
    },
    /// The Abbe number of what follows a surface, as a fraction of it; the index at d stays.
    Abbe {
        /// Which surface.
        surface: usize,
    },
    /// Turn of one surface about an axis through its vertex, degrees.
    SurfaceTilt {
        /// Which surface.
        surface: usize,
        /// About which axis.
        axis: Axis,
    },
    /// Shift of an element along an axis, mm.
    Decenter {
        /// First surface.
        first: usize,
        /// Last surface.
        last: usize,
        /// Along which axis.
        axis: Axis,
    },
    /// Turn of an element about an axis through the vertex of its first surface, degrees.
    Tilt {
        /// First surface.
        first: usize,
        /// Last surface.
        last: usize,
        /// About which axis.
        axis: Axis,
    },
}

/// How a perturbation is distributed within its tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Distribution {
    /// Even.
    #[default]
    Uniform,
    /// Normal, the tolerance at two standard deviations, cut off there.
    Normal,
    /// At either end: the worst of a machine that drifts to its limit.
    Ends,
}

impl Distribution {
    /// Standard deviation over the tolerance.
    pub fn deviation(self) -> f64 {
        match self {
            Distribution::Uniform => 1.0 / 3.0f64.sqrt(),
            // σ = 1/2, cut at 2 σ: σ² (1 − 4 φ(2) / (2 Φ(2) − 1)), with φ(2) = 0.0539910 and 2 Φ(2) − 1 = 0.9544997 (Johnson, Kotz &
            // Balakrishnan, "Continuous Univariate Distributions" 1, §10.1).
            Distribution::Normal => 0.5 * (1.0f64 - 4.0 * 0.053_990_97 / 0.954_499_74).sqrt(),
            Distribution::Ends => 1.0,
        }
    }

    /// The same of each of two parts of an error whose size has the tolerance and whose direction may be any.
    fn deviation_of_part(self) -> f64 {
        match self {
            // Over a disk.
            Distribution::Uniform => 0.5,
            // Of both parts together σ² (2 − 4 e⁻² / (1 − e⁻²)), a Rayleigh distribution cut at 2 σ, with σ = 1/2.
            Distribution::Normal => 0.5 * (1.0 - 2.0 / (2f64.exp() - 1.0)).sqrt(),
            Distribution::Ends => 0.5f64.sqrt(),
        }
    }

    /// A draw of both parts of an error, a pure function of a key: a vector no longer than 1.
    pub(super) fn draw_parts(self, key: u64) -> [f64; 2] {
        let (u, turn) = (uniform(key, 0), std::f64::consts::TAU * uniform(key, 1));
        let size = match self {
            Distribution::Uniform => u.sqrt(),
            Distribution::Normal => (-0.5 * (1.0 - u * (1.0 - (-2f64).exp())).ln()).sqrt(),
            Distribution::Ends => 1.0,
        };
        [size * turn.cos(), size * turn.sin()]
    }

    /// A draw from −1 to 1, a pure function of a key.
    pub fn draw(self, key: u64) -> f64 {
        match self {
            Distribution::Uniform => 2.0 * uniform(key, 0) - 1.0,
            Distribution::Ends => {
                if uniform(key, 0) < 0.5 {
                    -1.0
                } else {
                    1.0
                }
            }
            Distribution::Normal => {
                // Box–Muller; what lies beyond the cut (1 of 22) is drawn again.
                let normal = |i: u64| {
                    let r = (-2.0 * (1.0 - uniform(key, 2 * i)).ln()).sqrt();
                    r * (std::f64::consts::TAU * uniform(key, 2 * i + 1)).cos()
                };
                (0..100).map(normal).find(|v| v.abs() <= 2.0).map_or(0.0, |v| 0.5 * v)
            }
        }
    }
}

/// SplitMix64's output function (Steele, Lea & Flood 2014).
fn split_mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Several numbers as one key.
pub(crate) fn key(numbers: &[u64]) -> u64 {
    numbers
        .iter()
        .fold(0, |k, n| split_mix(k.wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_add(split_mix(*n ^ 0x5851_F42D_4C95_7F2D))))
}

/// Even in [0, 1): the `i`-th number of a key.
pub(crate) fn uniform(k: u64, i: u64) -> f64 {
    (key(&[k, i]) >> 11) as f64 / (1u64 << 53) as f64
}

/// A perturbation with its tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// What is wrong.
    pub change: Change,
    /// By how much, either way: mm, 1/mm, degrees, fringes or a fraction as [`Change`] says.
    pub half_range: f64,
    /// How it is distributed.
    pub distribution: Distribution,
    /// Which of two parts of one error it is, about x or along x first, where the tolerance limits the error in whatever direction: the other part is the parameter
    /// behind it or before it.
    pub part: Option<Axis>,
}

impl Change {
    /// What it is called: "radius of surface 3".
    pub fn name(self) -> String {
        let axis = |a: Axis| if a == Axis::X { "x" } else { "y" };
        match self {
            Change::Radius { surface } => format!("radius of surface {}", surface + 1),
            Change::Curvature { surface } => format!("power of surface {}", surface + 1),
            Change::Irregularity { surface, axis: Axis::X } => format!("irregularity of surface {} along the axes", surface + 1),
            Change::Irregularity { surface, axis: Axis::Y } => format!("irregularity of surface {} at 45°", surface + 1),
            Change::Gap { surface } => format!("gap after surface {}", surface + 1),
            Change::Index { surface } => format!("index after surface {}", surface + 1),
            Change::Abbe { surface } => format!("Abbe number after surface {}", surface + 1),
            Change::SurfaceTilt { surface, axis: a } => format!("tilt of surface {} about {}", surface + 1, axis(a)),
            Change::Decenter { first, last, axis: a } => format!("decentre of element {}-{} in {}", first + 1, last + 1, axis(a)),
            Change::Tilt { first, last, axis: a } => format!("tilt of element {}-{} about {}", first + 1, last + 1, axis(a)),
        }
    }

    /// Unit of its amount.
    pub fn unit(self) -> &'static str {
        match self {
            Change::Radius { .. } | Change::Gap { .. } | Change::Decenter { .. } => "mm",
            Change::Curvature { .. } => "1/mm",
            Change::Irregularity { .. } => "fringes",
            Change::Index { .. } | Change::Abbe { .. } => "",
            Change::SurfaceTilt { .. } | Change::Tilt { .. } => "°",
        }
    }
}

impl Parameter {
    /// Standard deviation over builds, over the tolerance.
    pub fn deviation(&self) -> f64 {
        if self.part.is_some() { self.distribution.deviation_of_part() } else { self.distribution.deviation() }
    }

    /// What it is called: "radius of surface 3".
    pub fn name(&self) -> String {
        self.change.name()
    }

    /// Unit of its amount.
    pub fn unit(&self) -> &'static str {
        self.change.unit()
    }
}

/// First and last surfaces of what is one piece: glass after glass is cemented, a mirror stands alone.
pub(super) fn elements_of(p: &Prescription) -> Vec<[usize; 2]> {
    let mut elements = vec![];
    let mut first = None;
    for (i, s) in p.surfaces.iter().enumerate() {
        let glass_after = s.glass.kind != GlassKind::Air;
        match (first, glass_after) {
            (None, true) => first = Some(i),
            (None, false) if s.mirror => elements.push([i, i]),
            (Some(f), false) => {
                elements.push([f, i]);
                first = None;
            }
            _ => {}
        }
    }
    // Glass up to the film.
    elements.extend(first.map(|f| [f, p.surfaces.len() - 1]));
    elements
}

/// The glass as a curve through its indices at four lines, which can be moved. A constant index stays one.
pub(super) fn movable(glass: &Glass) -> Result<Glass, GlassError> {
    shifted(glass, 0.0, 0.0)
}

/// The glass with another index at d, and its Abbe number changed by a fraction; absorption stays that at 550 nm.
pub(crate) fn shifted(glass: &Glass, index: f64, abbe: f64) -> Result<Glass, GlassError> {
    if let GlassKind::Constant(n) = glass.kind {
        return Ok(copy_absorption(Glass::constant(n + index)?, glass));
    }
    let nd = glass.index(D_NM);
    let at = |nm: f64| nd + index + (glass.index(nm) - nd) / (1.0 + abbe);
    Ok(copy_absorption(Glass::measured(at(D_NM), at(C_NM), at(F_NM), at(G_NM))?, glass))
}

/// A prescription carries one absorption for all wavelengths: that of the green.
fn copy_absorption(to: Glass, from: &Glass) -> Glass {
    const GREEN_NM: f64 = 550.0;
    match from.knows_absorption() {
        true => to.with_absorption(vec![(GREEN_NM, from.absorption(GREEN_NM))]),
        false => to,
    }
}

/// A profile with another [`Profile::base_curvature`]: the curvatures of a toroid keep their ratio, or their difference where there is none.
pub(crate) fn bent_to(profile: &Profile, curvature: f64) -> Profile {
    let before = profile.base_curvature();
    bend(profile, |c| if before != 0.0 { c * (curvature / before) } else { c + curvature })
}

/// Changes the curvature of a profile, of all its sections alike.
pub(crate) fn bend(profile: &Profile, change: impl Fn(f64) -> f64) -> Profile {
    match profile.clone() {
        Profile::Plane => match change(0.0) {
            0.0 => Profile::Plane,
            c => Profile::Sphere(c),
        },
        Profile::Sphere(c) => Profile::Sphere(change(c)),
        Profile::Conic { c, k } => Profile::Conic { c: change(c), k },
        Profile::Asphere(mut a) => {
            a.c = change(a.c);
            Profile::Asphere(a)
        }
        Profile::Fresnel(mut a) => {
            a.c = change(a.c);
            Profile::Fresnel(a)
        }
        Profile::Freeform(mut f) => {
            f.base.c = change(f.base.c);
            Profile::Freeform(f)
        }
        Profile::Forbes(f) => Profile::Forbes(f.with_curvature(change(f.c()))),
        Profile::Toroid { mut y, c_x } => {
            y.c = change(y.c);
            Profile::Toroid { y, c_x: change(c_x) }
        }
        Profile::Biconic { c_x, k_x, c_y, k_y } => Profile::Biconic { c_x: change(c_x), k_x, c_y: change(c_y), k_y },
    }
}

/// The lens with amounts of its perturbations, one a parameter, in their units.
pub(super) fn perturbed(p: &Prescription, parameters: &[Parameter], amounts: &[f64]) -> Result<Prescription, GlassError> {
    let mut lens = p.clone();
    let count = p.surfaces.len();
    let passes = Passes::of(p);
    // What several parameters change together.
    let mut irregular = vec![[0.0f64; 2]; count];
    let mut glass = vec![[0.0f64; 2]; count];
    let mut moved: Vec<Misalignment> = vec![];
    for (parameter, &amount) in parameters.iter().zip(amounts).filter(|(_, a)| **a != 0.0) {
        match parameter.change {
            Change::Radius { surface } => {
                for pass in passes.of_face(surface) {
                    let profile = &mut lens.surfaces[pass].profile;
                    *profile = bend(profile, |c| if c == 0.0 { 0.0 } else { c / (1.0 + c * amount) });
                }
            }
            Change::Curvature { surface } => {
                for pass in passes.of_face(surface) {
                    let profile = &mut lens.surfaces[pass].profile;
                    *profile = bend(profile, |c| c + amount);
                }
            }
            Change::Irregularity { surface, axis } => {
                passes.of_face(surface).for_each(|pass| irregular[pass][(axis == Axis::Y) as usize] += amount);
            }
            Change::Gap { surface } => {
                // Light that a mirror has turned runs through negative gaps.
                for pass in passes.of_gap(surface) {
                    lens.surfaces[pass].gap.values.iter_mut().flatten().for_each(|g| *g += amount * g.signum());
                }
            }
            Change::Index { surface } => passes.of_gap(surface).for_each(|pass| glass[pass][0] += amount),
            Change::Abbe { surface } => passes.of_gap(surface).for_each(|pass| glass[pass][1] += amount),
            Change::SurfaceTilt { surface, axis } => {
                passes.of_face(surface).for_each(|pass| lens.surfaces[pass].tilt[(axis == Axis::Y) as usize] += amount);
            }
            Change::Decenter { first, last, axis } | Change::Tilt { first, last, axis } => {
                let found = moved.iter().position(|m| (m.first, m.last) == (first, last));
                let at = found.unwrap_or_else(|| {
                    moved.push(Misalignment { first, last, decenter: [0.0; 3], tilt: [0.0; 3] });
                    moved.len() - 1
                });
                let axis = (axis == Axis::Y) as usize;
                match parameter.change {
                    Change::Decenter { .. } => moved[at].decenter[axis] += amount,
                    _ => moved[at].tilt[axis] += amount,
                }
            }
        }
    }
    for (i, s) in lens.surfaces.iter_mut().enumerate() {
        if glass[i] != [0.0; 2] {
            s.glass = shifted(&s.glass, glass[i][0], glass[i][1])?;
        }
        let [along, across] = irregular[i];
        if (along, across) != (0.0, 0.0) {
            // Sag differs by ±δ h²/2 in the two sections: from peak to valley δ h² = fringes × λ/2.
            let h = s.semi_diameter.unwrap_or(f64::INFINITY);
            let delta = f64::hypot(along, across) * 0.5 * FRINGE_NM * 1e-6 / (h * h);
            let (c, k) = match s.profile {
                Profile::Plane => (0.0, 0.0),
                Profile::Sphere(c) => (c, 0.0),
                Profile::Conic { c, k } => (c, k),
                // The sheet refuses these.
                _ => continue,
            };
            s.profile = Profile::Biconic { c_x: c + delta, k_x: k, c_y: c - delta, k_y: k };
            s.tilt[2] += 0.5 * f64::atan2(across, along).to_degrees();
        }
    }
    lens.misalignments.append(&mut moved);
    Ok(lens)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;

    #[test]
    fn two_parts_of_an_error_are_together_within_the_tolerance() {
        for distribution in [Distribution::Uniform, Distribution::Normal, Distribution::Ends] {
            const COUNT: usize = 20_000;
            let draws: Vec<[f64; 2]> = (0..COUNT as u64).map(|i| distribution.draw_parts(key(&[8, i]))).collect();
            let largest = draws.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
            assert!(largest < 1.0 + 1e-12 && largest > 0.99, "{distribution:?} {largest}");
            let expected = distribution.deviation_of_part();
            for part in 0..2 {
                let mean = draws.iter().map(|d| d[part]).sum::<f64>() / COUNT as f64;
                let deviation = (draws.iter().map(|d| d[part] * d[part]).sum::<f64>() / COUNT as f64).sqrt();
                let error = 4.0 * expected / (COUNT as f64).sqrt();
                assert!(mean.abs() < error && (deviation - expected).abs() < error, "{distribution:?} {mean} {deviation}");
            }
        }
    }

    #[test]
    fn draws_have_the_stated_deviation_and_stay_within_the_tolerance() {
        for distribution in [Distribution::Uniform, Distribution::Normal, Distribution::Ends] {
            const COUNT: u64 = 20_000;
            let draws: Vec<f64> = (0..COUNT).map(|i| distribution.draw(key(&[7, i]))).collect();
            assert!(draws.iter().all(|v| v.abs() <= 1.0));
            let mean = draws.iter().sum::<f64>() / COUNT as f64;
            let deviation = (draws.iter().map(|v| v * v).sum::<f64>() / COUNT as f64).sqrt();
            // Four standard errors of 20 000 draws: of the mean σ/√n, of the deviation at most σ/√n.
            let error = 4.0 * distribution.deviation() / (COUNT as f64).sqrt();
            assert!(mean.abs() < error, "{distribution:?} {mean}");
            assert!((deviation - distribution.deviation()).abs() < error + 1e-12, "{distribution:?} {deviation}");
        }
    }

    #[test]
    fn cemented_surfaces_are_one_element() {
        let p = embedded("double-gauss-50mm").unwrap();
        assert_eq!(elements_of(&p), [[0, 1], [2, 4], [6, 8], [9, 10]]);
    }

    #[test]
    fn a_moved_glass_has_the_index_and_the_abbe_number_asked_for() {
        let bk7 = Glass::parse("N-BK7").unwrap();
        let other = shifted(&bk7, 5e-4, 0.01).unwrap();
        // 1e-9: the curve goes through the four lines exactly.
        assert!((other.index(D_NM) - bk7.index(D_NM) - 5e-4).abs() < 1e-9);
        // ν = (nd − 1)/(nF − nC): 1 % more, and 5e-4 more in the numerator.
        let expected = bk7.abbe() * 1.01 * (bk7.index(D_NM) + 5e-4 - 1.0) / (bk7.index(D_NM) - 1.0);
        assert!((other.abbe() / expected - 1.0).abs() < 1e-6, "{} {expected}", other.abbe());
        // What is written reads back as the same glass.
        let back = Glass::parse(&other.written()).unwrap();
        assert!((back.index(500.0) - other.index(500.0)).abs() < 1e-9);
    }
}
