//! Files of measured materials, tabulated from closed forms. What the format's warps do is computed here by other means than in the library: bisection in
//! double precision.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

pub type V = [f64; 3];

pub fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn direction(theta: f64, phi: f64) -> V {
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

pub fn half(a: V, b: V) -> V {
    let h = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let length = dot(h, h).sqrt();
    h.map(|c| c / length)
}

pub fn mirrored(w: V, h: V) -> V {
    let d = 2.0 * dot(w, h);
    [h[0] * d - w[0], h[1] * d - w[1], h[2] * d - w[2]]
}

/// GGX of two widths. Source: Heitz 2014.
#[derive(Clone, Copy)]
pub struct Facets(pub f64, pub f64);

impl Facets {
    pub fn d(&self, h: V) -> f64 {
        let e = (h[0] / self.0).powi(2) + (h[1] / self.1).powi(2) + h[2] * h[2];
        1.0 / (PI * self.0 * self.1 * e * e)
    }

    fn lambda(&self, w: V) -> f64 {
        let t = ((self.0 * w[0]).powi(2) + (self.1 * w[1]).powi(2)) / (w[2] * w[2]).max(1e-12);
        0.5 * ((1.0 + t).sqrt() - 1.0)
    }

    /// Projected area of the facets.
    pub fn sigma(&self, w: V) -> f64 {
        0.5 * (w[2] + (w[2] * w[2] + (self.0 * w[0]).powi(2) + (self.1 * w[1]).powi(2)).sqrt())
    }

    /// Fraction of facets visible from both.
    pub fn g2(&self, a: V, b: V) -> f64 {
        1.0 / (1.0 + self.lambda(a) + self.lambda(b))
    }
}

/// A closed form: the BRDF at a wavelength, and facets that its table is made with.
pub struct Closed {
    pub facets: Facets,
    pub brdf: fn(Facets, V, V, f64) -> f64,
}

pub fn metal(facets: Facets, wo: V, wi: V, nm: f64) -> f64 {
    let h = half(wo, wi);
    let r0 = 0.3 + 0.6 * (nm - 380.0) / 400.0;
    let f = r0 + (1.0 - r0) * (1.0 - dot(wo, h)).powi(5);
    f * facets.d(h) * facets.g2(wo, wi) / (4.0 * wo[2] * wi[2])
}

/// Reflects nine tenths, at all wavelengths.
pub fn paper(_: Facets, _: V, _: V, _: f64) -> f64 {
    0.9 / PI
}

pub fn white(_: Facets, _: V, _: V, _: f64) -> f64 {
    1.0 / PI
}

/// How finely a table is made.
pub struct Fineness {
    /// Measured φ: 1 makes it isotropic.
    pub phi: Vec<f64>,
    /// Measured θ, between 0 and almost π/2.
    pub theta: usize,
    pub normals: usize,
    pub samples: usize,
    pub nm: Vec<f64>,
}

impl Fineness {
    pub fn isotropic() -> Self {
        Fineness { phi: vec![0.0], theta: 24, normals: 64, samples: 32, nm: (0..10).map(|i| 360.0 + 50.0 * i as f64).collect() }
    }
}

struct Field {
    name: &'static str,
    kind: u8,
    shape: Vec<usize>,
    data: Vec<u8>,
}

fn floats(name: &'static str, shape: &[usize], values: &[f64]) -> Field {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
    Field { name, kind: 10, shape: shape.to_vec(), data: values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect() }
}

fn bytes(name: &'static str, data: &[u8]) -> Field {
    Field { name, kind: 1, shape: vec![data.len()], data: data.to_vec() }
}

fn tensor_file(fields: &[Field]) -> Vec<u8> {
    let head: usize = 18 + fields.iter().map(|f| 2 + f.name.len() + 2 + 1 + 8 + 8 * f.shape.len()).sum::<usize>();
    let mut file = [b"tensor_file\0".as_slice(), &[1, 0], &(fields.len() as u32).to_le_bytes()].concat();
    let mut at = head;
    for f in fields {
        file.extend((f.name.len() as u16).to_le_bytes());
        file.extend(f.name.bytes());
        file.extend((f.shape.len() as u16).to_le_bytes());
        file.push(f.kind);
        file.extend((at as u64).to_le_bytes());
        f.shape.iter().for_each(|n| file.extend((*n as u64).to_le_bytes()));
        at += f.data.len();
    }
    fields.iter().for_each(|f| file.extend(&f.data));
    file
}

/// A place in 0..1 at which a rising function reaches a value.
fn bisect(value: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        if f(middle) < value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// ∫ from 0 to x of what is linear between nodes at equal steps over 0..1.
fn integral(nodes: &[f64], x: f64) -> f64 {
    let n = nodes.len() - 1;
    let place = (x * n as f64).min(n as f64 - 1e-12);
    let (i, t) = (place as usize, place.fract());
    let whole: f64 = nodes[..=i].windows(2).map(|w| 0.5 * (w[0] + w[1])).sum();
    (whole + t * (nodes[i] + 0.5 * t * (nodes[i + 1] - nodes[i]))) / n as f64
}

/// The row of a square grid at a height.
fn row_at(grid: &[f64], n: usize, y: f64) -> Vec<f64> {
    let place = (y * (n - 1) as f64).min(n as f64 - 1.0 - 1e-12);
    let (j, t) = (place as usize, place.fract());
    (0..n).map(|i| grid[j * n + i] * (1.0 - t) + grid[(j + 1) * n + i] * t).collect()
}

/// Where a warp takes a point of the unit square.
fn warped(grid: &[f64], n: usize, [x, y]: [f64; 2]) -> [f64; 2] {
    let rows: Vec<f64> = grid.chunks(n).map(|row| integral(row, 1.0)).collect();
    let total = integral(&rows, 1.0);
    let y = bisect(y * total, |y| integral(&rows, y));
    let row = row_at(grid, n, y);
    let total = integral(&row, 1.0);
    [bisect(x * total, |x| integral(&row, x)), y]
}

/// A tensor file of a closed form. `bands`: which numbers stand for wavelengths; three without wavelengths make an RGB table.
pub fn adaptive(closed: &Closed, fineness: &Fineness, rgb: Option<[f64; 3]>) -> Vec<u8> {
    let Fineness { phi, theta, normals, samples, nm } = fineness;
    let (n, m, isotropic) = (*normals, *samples, phi.len() <= 2);
    let facets = closed.facets;
    let theta: Vec<f64> = (0..*theta).map(|i| 1.5533 * i as f64 / (*theta - 1) as f64).collect();
    let node = |i: usize, n: usize| i as f64 / (n - 1) as f64;
    let theta_of = |u: f64| u * u * FRAC_PI_2;
    let phi_of = |v: f64| (2.0 * v - 1.0) * PI;
    let (mut ndf, mut sigma) = (vec![], vec![]);
    for row in 0..n {
        for column in 0..n {
            let w = direction(theta_of(node(column, n)), phi_of(node(row, n)));
            ndf.push(facets.d(w));
            sigma.push(facets.sigma(w));
        }
    }
    let bands = if rgb.is_some() { 3 } else { nm.len() };
    let (mut vndf, mut luminance, mut spectra) = (vec![], vec![], vec![]);
    for phi in phi {
        for theta in &theta {
            let wo = direction(*theta, *phi);
            let zero = if isotropic { *phi } else { 0.0 };
            let mut grid = Vec::with_capacity(n * n);
            for row in 0..n {
                for column in 0..n {
                    let u = node(column, n);
                    let h = direction(theta_of(u), phi_of(node(row, n)) + zero);
                    grid.push(facets.d(h) * dot(wo, h).max(0.0) * u * theta_of(u).sin());
                }
            }
            let mut slice = vec![0.0; bands * m * m];
            for row in 0..m {
                for column in 0..m {
                    let [u, v] = warped(&grid, n, [node(column, m), node(row, m)]);
                    let h = direction(theta_of(u), phi_of(v) + zero);
                    let wi = mirrored(wo, h);
                    for band in 0..bands {
                        let (nm, scale) = rgb.map_or_else(|| (nm[band], 1.0), |rgb| (550.0, rgb[band]));
                        let light = (closed.brdf)(facets, wo, wi, nm) * scale * wi[2] * 4.0 * facets.sigma(wo) / facets.d(h);
                        // Below the horizon, which cells lie across, it goes on below 0.
                        let value = if wi[2] > 0.0 { light } else { -light.abs() };
                        slice[(band * m + row) * m + column] = value;
                    }
                }
            }
            luminance.extend((0..m * m).map(|i| (0..bands).map(|b| slice[b * m * m + i].max(0.0)).sum::<f64>() / bands as f64));
            vndf.extend(grid);
            spectra.extend(slice);
        }
    }
    let views = [phi.len(), theta.len()];
    let mut fields = vec![
        bytes("description", b"closed form"),
        bytes("jacobian", &[1]),
        floats("theta_i", &[theta.len()], &theta),
        floats("phi_i", &[phi.len()], phi),
        floats("ndf", &[n, n], &ndf),
        floats("sigma", &[n, n], &sigma),
        floats("vndf", &[views[0], views[1], n, n], &vndf),
        floats("luminance", &[views[0], views[1], m, m], &luminance),
        floats(if rgb.is_some() { "rgb" } else { "spectra" }, &[views[0], views[1], bands, m, m], &spectra),
    ];
    if rgb.is_none() {
        fields.push(floats("wavelengths", &[nm.len()], nm));
    }
    tensor_file(&fields)
}

/// A MERL table of a closed form at 550 nm, times a colour.
pub fn merl(counts: [usize; 3], rgb: [f64; 3], f: impl Fn(V, V) -> f64) -> Vec<u8> {
    let mut file: Vec<u8> = counts.iter().flat_map(|n| (*n as i32).to_le_bytes()).collect();
    let middle = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
    let mut all = Vec::with_capacity(counts.iter().product());
    for a in 0..counts[0] {
        let theta_h = middle(a, counts[0]).powi(2) * FRAC_PI_2;
        let (h, along) = (direction(theta_h, 0.0), direction(theta_h + FRAC_PI_2, 0.0));
        for b in 0..counts[1] {
            let (sin, cos) = (middle(b, counts[1]) * FRAC_PI_2).sin_cos();
            for c in 0..counts[2] {
                let (sin_phi, cos_phi) = (middle(c, counts[2]) * 0.5 * TAU).sin_cos();
                let wi = [h[0] * cos + along[0] * sin * cos_phi, sin * sin_phi, h[2] * cos + along[2] * sin * cos_phi];
                let wo = mirrored(wi, h);
                all.push(if wi[2] > 0.0 && wo[2] > 0.0 { f(wo, wi) } else { -1.0 });
            }
        }
    }
    for (scale, channel) in [1.0, 1.15, 1.66].iter().zip(rgb) {
        file.extend(all.iter().flat_map(|v| (if *v < 0.0 { -1.0 } else { v * channel * 1500.0 / scale }).to_le_bytes()));
    }
    file
}
