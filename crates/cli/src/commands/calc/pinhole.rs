//! `calc pinhole`: the diameter at which a pinhole camera is sharpest.
//!
//! A wide hole blurs by its own size, a narrow one by diffraction; in between d = c √(λ f'), with f' the image distance over 1 + image distance / object
//! distance: the length of the Fresnel zones (zone radii √(k λ f')). Which c is best depends on what sharp means.
//!
//! The contrast of a hole of any diameter is that of a lens of that aperture that is out of focus by 1 / f' (Hopkins 1955, "The frequency response of a
//! defocused optical system", Proc. R. Soc. A 231, 91): diffraction and the hole's own size in one, with nothing left out but the angle off the axis.

use super::exposure::positive;
use crate::args::PinholeArgs;
use crate::commands::{print_json, shown};
use crate::paint;
use crate::watch::say;
use diopter::lens::draw::{Axis, Chart, Color, Figure, Line, Style};
use glam::DVec2;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::Write as _;

/// Constants c, who found them, and what they hold for.
const BEST: [(f64, &str, &str); 3] = [
    // The Airy disk's diameter of a distant point is 2.44 λ f / d.
    (1.562_049_935, "geometry = diffraction", "the hole as wide as the Airy disk that it makes"),
    // Rayleigh 1891, "On pin-hole photography", Philosophical Magazine 31(189), 87: a radius of 0.95 √(λ f).
    (1.9, "Rayleigh 1891", "finest detail by experiment: 0.9 of the area of the first Fresnel zone"),
    // Young 1971, "Pinhole Optics", Applied Optics 10(12), 2763: f = s²/λ, s the radius.
    (2.0, "Young 1971", "the first Fresnel zone: brightest middle"),
];

/// Diameter (mm) of the hole before a film, both distances in mm (the object's may be infinite).
fn diameter(c: f64, distance: f64, object: f64, nm: f64) -> f64 {
    c * (nm * 1e-6 / (1.0 / distance + 1.0 / object)).sqrt()
}

/// Steps of the integral of the contrast.
const STEPS: usize = 400;
/// Diameters that are tried, from and to, of √(λ f'), and by which factor from one to the next.
const TRIED: [f64; 2] = [0.5, 6.0];
const FACTOR: f64 = 1.01;
/// Contrast at which a resolution is told.
const LEVELS: [f64; 2] = [0.5, 0.1];

/// A hole before a film, mm.
#[derive(Clone, Copy)]
struct Hole {
    diameter: f64,
    distance: f64,
    /// f'.
    length: f64,
    wavelength: f64,
}

impl Hole {
    /// Contrast of a frequency on the film, 1/mm. The pupil over its copy, shifted by s = λ ν v: within the overlap the phases differ by 2π ν v x / f'.
    fn contrast(&self, frequency: f64) -> f64 {
        let (a, s) = (0.5 * self.diameter, self.wavelength * frequency * self.distance);
        let reach = a - 0.5 * s;
        if reach <= 0.0 {
            return 0.0;
        }
        let turns = frequency * self.distance / self.length;
        // x = reach · sin u: the root at the edge of the overlap is smooth so.
        let step = 0.5 * PI / STEPS as f64;
        let sum: f64 = (0..STEPS)
            .map(|k| {
                let u = (k as f64 + 0.5) * step;
                let x = reach * u.sin();
                (a * a - (x + 0.5 * s).powi(2)).max(0.0).sqrt() * (TAU * turns * x).cos() * reach * u.cos()
            })
            .sum();
        4.0 / (PI * a * a) * sum * step
    }

    /// By its size alone: the image of a point is a disk as large as the hole, (1 + v / u) times.
    fn by_size(&self, frequency: f64) -> f64 {
        let x = PI * self.diameter * (self.distance / self.length) * frequency;
        if x < 1e-6 { 1.0 } else { 2.0 * bessel_j1(x) / x }
    }

    /// By diffraction alone: as a lens in focus.
    fn by_diffraction(&self, frequency: f64) -> f64 {
        Hole { length: f64::INFINITY, ..*self }.contrast(frequency)
    }

    /// Where the contrast by diffraction alone ends, 1/mm.
    fn diffraction_cutoff(&self) -> f64 {
        self.diameter / (self.wavelength * self.distance)
    }

    /// A frequency beyond the first zero of the contrast by size alone (2 J₁(x) / x = 0 at x = 3.83 < 4π), 1/mm.
    fn size_cutoff(&self) -> f64 {
        4.0 * self.length / (self.distance * self.diameter)
    }

    /// Lowest frequency at which a contrast falls to a level, 1/mm: below `most`, in small steps.
    fn falls_to(&self, level: f64, most: f64, contrast: impl Fn(&Hole, f64) -> f64) -> f64 {
        let step = most / 400.0;
        let first = (1..=400).map(|k| k as f64 * step).find(|f| contrast(self, *f) < level).unwrap_or(most);
        let (mut low, mut high) = (first - step, first);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if contrast(self, middle) < level { high = middle } else { low = middle }
        }
        0.5 * (low + high)
    }

    /// The same of all that blurs, which ends with the lower of the two.
    fn resolves(&self, level: f64) -> f64 {
        self.falls_to(level, self.diffraction_cutoff().min(self.size_cutoff()), Hole::contrast)
    }
}

/// Bessel function of the first kind and order: J₁(x) = (1/π) ∫₀^π cos(u − x sin u) du; the midpoint rule of a periodic function converges at once.
fn bessel_j1(x: f64) -> f64 {
    let steps = 64 + x.abs() as usize;
    let step = PI / steps as f64;
    (0..steps).map(|k| (k as f64 + 0.5) * step).map(|u| (u - x * u.sin()).cos()).sum::<f64>() * step / PI
}

/// The diameter (mm) with the highest frequency at which the contrast falls to a level, and that frequency (1/mm).
fn sharpest(hole: Hole, level: f64) -> (f64, f64) {
    let root = (hole.wavelength * hole.length).sqrt();
    let count = ((TRIED[1] / TRIED[0]).ln() / FACTOR.ln()) as i32;
    let each = (0..=count)
        .map(|k| TRIED[0] * root * FACTOR.powi(k))
        .map(|diameter| (diameter, Hole { diameter, ..hole }.resolves(level)));
    each.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((root, 0.0))
}

/// Frequency at which the contrast is one half over the diameter: of the hole, and of its size and diffraction alone.
fn figure(hole: Hole, best: (f64, f64)) -> Figure {
    let size = DVec2::new(560.0, 380.0);
    let root = (hole.wavelength * hole.length).sqrt();
    let diameters: Vec<f64> = (0..=110).map(|k| root * (0.5 + 0.05 * f64::from(k))).collect();
    let most = 1.6 * best.1;
    let curve = |name: &str, color: Color, style: Style, resolves: fn(&Hole) -> f64| {
        let point = |d: &f64| DVec2::new(*d, resolves(&Hole { diameter: *d, ..hole }));
        Line { name: name.into(), color, style, points: diameters.iter().map(point).filter(|p| p.y <= most).collect() }
    };
    let mark = |(c, name, _): &(f64, &str, &str)| {
        let d = diameter(*c, hole.distance, f64::INFINITY, hole.wavelength * 1e6) * (hole.length / hole.distance).sqrt();
        let name = name.split(' ').next().unwrap_or(name).to_owned();
        Line {
            name: format!("{name}: {d:.3} mm"),
            color: [120, 120, 120],
            style: Style::Broken,
            points: vec![DVec2::new(d, 0.0), DVec2::new(d, most)],
        }
    };
    let mut lines = vec![
        curve("both", [204, 51, 51], Style::Full, |h| h.resolves(LEVELS[0])),
        curve("size of the hole alone", [34, 85, 170], Style::Broken, |h| h.falls_to(LEVELS[0], h.size_cutoff(), Hole::by_size)),
        curve("diffraction alone", [40, 140, 70], Style::Broken, |h| {
            h.falls_to(LEVELS[0], h.diffraction_cutoff(), Hole::by_diffraction)
        }),
    ];
    lines.extend(BEST[1..].iter().map(mark));
    let mut figure = Figure::new(size.x, size.y);
    Chart {
        title: format!(
            "pinhole {} mm before the film: sharpest {:.3} mm across (MTF50 {:.2} cycles/mm)",
            shown(hole.distance),
            best.0,
            best.1
        ),
        x: Axis { label: "diameter, mm".into(), range: [0.0, 6.0 * root] },
        y: Axis { label: "MTF50, cycles/mm".into(), range: [0.0, most] },
        lines,
    }
    .draw(&mut figure, DVec2::ZERO, size);
    figure
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &PinholeArgs, json: bool) -> anyhow::Result<()> {
    let distance = positive("distance", args.distance.0)?;
    let object = match args.object.0 {
        far if far == f64::INFINITY => far,
        near => 1000.0 * positive("object", near)?,
    };
    let nm = positive("wavelength", args.wavelength)?;
    let outputs = paint::prepare(&args.output)?;
    let hole = Hole { diameter: 1.0, distance, length: 1.0 / (1.0 / distance + 1.0 / object), wavelength: nm * 1e-6 };
    let best = LEVELS.map(|level| sharpest(hole, level));
    if !outputs.is_empty() {
        for path in paint::write(outputs, &figure(hole, best[0]))? {
            say(&format!("wrote {}", path.display()));
        }
    }
    let found = BEST.map(|(c, name, meaning)| (c, name, meaning, diameter(c, distance, object, nm)));
    if json {
        let rows: Vec<_> = found
            .iter()
            .map(|(c, name, meaning, d)| {
                serde_json::json!({ "constant": c, "source": name, "meaning": meaning, "diameter_mm": d, "f_number": distance / d })
            })
            .collect();
        let sharpest: Vec<_> = LEVELS
            .iter()
            .zip(best)
            .map(|(level, (d, f))| serde_json::json!({ "contrast": level, "diameter_mm": d, "f_number": distance / d, "frequency_per_mm": f }))
            .collect();
        let object = object.is_finite().then_some(object);
        let all = serde_json::json!({ "distance_mm": distance, "object_mm": object, "wavelength_nm": nm, "pinholes": rows, "sharpest": sharpest });
        return print_json(&all);
    }
    let mut text = String::new();
    let at = if object.is_finite() { format!("{} m away", shown(object / 1000.0)) } else { "far away".into() };
    writeln!(text, "film {} mm behind the hole, objects {at}, {} nm: diameter c √(λ f')", shown(distance), shown(nm))?;
    writeln!(text, "{:>6} {:>12} {:>9}", "c", "diameter", "aperture")?;
    for (c, name, meaning, d) in found {
        writeln!(text, "{c:>6.3} {d:>9.4} mm {:>9}   {name}: {meaning}", format!("f/{:.0}", distance / d))?;
    }
    let root = (hole.wavelength * hole.length).sqrt();
    for (level, (d, f)) in LEVELS.iter().zip(best) {
        let aperture = format!("f/{:.0}", distance / d);
        writeln!(
            text,
            "{:>6.3} {d:>9.4} mm {aperture:>9}   highest MTF{:.0}: {f:.2} cycles/mm, by the contrast itself",
            d / root,
            100.0 * level
        )?;
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_have_the_diameters_of_the_sources() {
        // Young: s² = λ f. 100 mm and 500 nm: s = 0.2236 mm.
        assert!((diameter(2.0, 100.0, f64::INFINITY, 500.0) - 2.0 * 0.05f64.sqrt()).abs() < 1e-12);
        // As wide as the Airy disk: d² = 2.44 λ f.
        let d = diameter(BEST[0].0, 50.0, f64::INFINITY, 550.0);
        assert!((d - 2.44 * 550e-6 * 50.0 / d).abs() < 1e-6, "{d}");
        // An object as far before the hole as the film is behind it: half of the length, 1/√2 of the diameter.
        let near = diameter(1.9, 50.0, 50.0, 550.0);
        assert!((near * 2f64.sqrt() - diameter(1.9, 50.0, f64::INFINITY, 550.0)).abs() < 1e-12);
    }

    #[test]
    fn the_contrast_of_a_hole_lies_between_its_size_and_diffraction() {
        let hole = |diameter| Hole { diameter, distance: 50.0, length: 50.0, wavelength: 550e-6 };
        // A wide hole: the disk of its size, 2 J1(x) / x. A narrow one: a lens in focus, whose contrast at half of the cutoff is 0.391.
        let wide = hole(1.2);
        for f in [0.2, 0.4, 0.6] {
            assert!((wide.contrast(f) - wide.by_size(f)).abs() < 0.02, "{f}: {} {}", wide.contrast(f), wide.by_size(f));
        }
        let narrow = hole(0.03);
        let cutoff = 0.03 / (550e-6 * 50.0);
        assert!((narrow.by_diffraction(0.5 * cutoff) - 0.391_0).abs() < 5e-4);
        assert!((narrow.contrast(0.5 * cutoff) - 0.391_0).abs() < 5e-3);
        assert!((hole(0.2).contrast(0.0) - 1.0).abs() < 1e-4 && (bessel_j1(3.831_706).abs() < 1e-6));
        // Alone, the one goes with 1 / diameter and the other with the diameter, however wide the hole: 2 J1(x) / x = ½ at x = 2.2150894, a lens in focus has 0.5
        // at 0.4040 of its cutoff.
        for diameter in [0.03, 0.2, 1.2] {
            let hole = hole(diameter);
            let (size, diffraction) = (
                hole.falls_to(0.5, hole.size_cutoff(), Hole::by_size),
                hole.falls_to(0.5, hole.diffraction_cutoff(), Hole::by_diffraction),
            );
            assert!((size * PI * diameter - 2.215_089).abs() < 1e-4, "{diameter}: {}", size * PI * diameter);
            assert!(
                (diffraction / hole.diffraction_cutoff() - 0.4040).abs() < 5e-4,
                "{diameter}: {}",
                diffraction / hole.diffraction_cutoff()
            );
        }
        // The best hole is near those of the sources, and worse on both sides.
        let root = (550e-6f64 * 50.0).sqrt();
        let (best, at_best) = sharpest(hole(1.0), 0.5);
        assert!((1.2..2.2).contains(&(best / root)), "{}", best / root);
        for other in [0.7, 1.5] {
            assert!(hole(other * best).resolves(0.5) < at_best);
        }
    }
}
