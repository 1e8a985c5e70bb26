//! Fits smooth spectra to colours: the solver behind `upsample`, shared with the build script.
//!
//! A reflectance is S(c₀x² + c₁x + c₂) with S(p) = ½ + p / (2√(1 + p²)) and x = (λ − 580 nm) / 200 nm. Coefficients are
//! found by damped Gauss-Newton steps on the CIELAB difference under D65. Source: Jakob & Hanika 2019, "A
//! Low-Dimensional Function Space for Efficient Spectral Upsampling", CGF 38(2), §3–4. We differ in the scaling of x
//! (theirs is λ in nm; ours keeps the coefficients near 1 and single precision safe).

use glam::{DMat3, DVec3};

/// Nodes along each axis of the table.
pub const NODES: usize = 32;

/// Node position along the brightness axis: denser at both ends, where the sigmoid saturates.
pub fn brightness_of_node(k: usize) -> f64 {
    let smoothstep = |x: f64| x * x * (3.0 - 2.0 * x);
    smoothstep(smoothstep(k as f64 / (NODES - 1) as f64)).clamp(1e-4, 1.0 - 1e-4)
}

/// Node position along the two chroma axes: denser near 0, where a little of a component changes a saturated colour most.
pub fn chroma_of_node(i: usize) -> f64 {
    (i as f64 / (NODES - 1) as f64).powi(2)
}

/// What the fit integrates over: observer times D65, scaled so that a perfect reflector has Y = 1.
pub struct Fit {
    /// (x, weight of X, Y, Z) at 380–780 nm in 5 nm.
    samples: Vec<(f64, DVec3)>,
    white: DVec3,
    xyz_from_srgb: DMat3,
}

impl Fit {
    /// `observer`: rows of nm, x̄, ȳ, z̄ at 1 nm; `d65`: rows of (nm, power) at 5 nm.
    pub fn new(observer: &[Vec<f64>], d65: &[(f64, f64)]) -> Self {
        let mut samples: Vec<(f64, DVec3)> = d65
            .iter()
            .map(|&(nm, power)| {
                let row = observer.iter().find(|r| r[0] == nm).expect("the observer covers the illuminant");
                ((nm - 580.0) / 200.0, DVec3::new(row[1], row[2], row[3]) * power)
            })
            .collect();
        let y: f64 = samples.iter().map(|s| s.1.y).sum();
        samples.iter_mut().for_each(|s| s.1 /= y);
        let white = samples.iter().map(|s| s.1).sum();
        // sRGB → XYZ by the primaries, with the illuminant's own white, so that RGB white is a reflectance of 1.
        let xyz = |x: f64, y: f64| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let p = DMat3::from_cols(xyz(0.64, 0.33), xyz(0.30, 0.60), xyz(0.15, 0.06));
        let xyz_from_srgb = p * DMat3::from_diagonal(p.inverse() * white);
        Fit { samples, white, xyz_from_srgb }
    }

    /// CIELAB of XYZ and its derivative by XYZ.
    fn lab(&self, xyz: DVec3) -> (DVec3, DMat3) {
        const EDGE: f64 = 216.0 / 24389.0;
        let mut f = [0.0; 3];
        let mut df = [0.0; 3];
        for k in 0..3 {
            let t = xyz[k] / self.white[k];
            (f[k], df[k]) = if t > EDGE {
                (t.cbrt(), 1.0 / (3.0 * t.cbrt().powi(2) * self.white[k]))
            } else {
                (t * 841.0 / 108.0 + 4.0 / 29.0, 841.0 / 108.0 / self.white[k])
            };
        }
        let lab = DVec3::new(116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2]));
        let jacobian = DMat3::from_cols(
            DVec3::new(0.0, 500.0 * df[0], 0.0),
            DVec3::new(116.0 * df[1], -500.0 * df[1], 200.0 * df[1]),
            DVec3::new(0.0, 0.0, -200.0 * df[2]),
        );
        (lab, jacobian)
    }

    /// XYZ of the spectrum with coefficients `c` and its derivative by them.
    fn xyz(&self, c: DVec3) -> (DVec3, DMat3) {
        let mut xyz = DVec3::ZERO;
        let mut jacobian = DMat3::ZERO;
        for &(x, weight) in &self.samples {
            let p = (c.x * x + c.y) * x + c.z;
            let root = 1.0 / (1.0 + p * p).sqrt();
            xyz += weight * (0.5 + 0.5 * p * root);
            let d = weight * (0.5 * root * root * root);
            jacobian.x_axis += d * (x * x);
            jacobian.y_axis += d * x;
            jacobian.z_axis += d;
        }
        (xyz, jacobian)
    }

    /// Coefficients whose spectrum has the linear sRGB colour `rgb` under D65, searched from `start`.
    pub fn solve(&self, rgb: DVec3, start: DVec3) -> DVec3 {
        let target = self.lab(self.xyz_from_srgb * rgb).0;
        let residual = |c: DVec3| {
            let (xyz, dxyz) = self.xyz(c);
            let (lab, dlab) = self.lab(xyz);
            (lab - target, dlab * dxyz)
        };
        let mut c = start;
        let (mut r, mut j) = residual(c);
        let mut damping = 1e-6;
        for _ in 0..60 {
            if r.length_squared() < 1e-10 {
                break;
            }
            // (JᵀJ + μ diag) δ = Jᵀ r
            let normal = j.transpose() * j;
            let diagonal = DVec3::new(normal.x_axis.x, normal.y_axis.y, normal.z_axis.z);
            let step = (normal + DMat3::from_diagonal(diagonal * damping + DVec3::splat(1e-9))).inverse() * (j.transpose() * r);
            let tried = (c - step).clamp(DVec3::splat(-400.0), DVec3::splat(400.0));
            let (r2, j2) = residual(tried);
            if r2.length_squared() < r.length_squared() {
                (c, r, j) = (tried, r2, j2);
                damping = (damping * 0.2).max(1e-9);
            } else {
                damping = (damping * 8.0).max(1e-6);
                if damping > 1e9 {
                    break;
                }
            }
        }
        c
    }

    /// The whole table: `[largest component][brightness][second][third][coefficient]`, flattened.
    ///
    /// Second and third are the components after the largest in cyclic order, divided by it.
    pub fn table(&self) -> Vec<f32> {
        let mut table = vec![0.0f32; 3 * NODES * NODES * NODES * 3];
        for largest in 0..3 {
            for second in 0..NODES {
                for third in 0..NODES {
                    // From a middle brightness to both ends, each fit starting from its neighbour.
                    let middle = NODES / 5;
                    let mut start = DVec3::ZERO;
                    for k in (middle..NODES).chain((0..middle).rev()) {
                        let at = |k: usize| (((largest * NODES + k) * NODES + second) * NODES + third) * 3;
                        if k + 1 == middle {
                            start = DVec3::from_array([0, 1, 2].map(|i| table[at(middle) + i] as f64));
                        }
                        let z = brightness_of_node(k);
                        let mut rgb = [0.0; 3];
                        rgb[largest] = z;
                        rgb[(largest + 1) % 3] = z * chroma_of_node(second);
                        rgb[(largest + 2) % 3] = z * chroma_of_node(third);
                        start = self.solve(DVec3::from_array(rgb), start);
                        for i in 0..3 {
                            table[at(k) + i] = start[i] as f32;
                        }
                    }
                }
            }
        }
        table
    }
}
