//! Spot diagrams and ray fans.

use super::{Beam, Bench};
use crate::draw::{Axis, Chart, Figure, Line, Style, wavelength_color};
use crate::ray::{Apertures, TraceDirection, TracedRay};
use glam::DVec2;

/// Where the rays of a field point land, one colour.
#[derive(Clone, Debug)]
pub struct Spot {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Wavelength, nm.
    pub nm: f64,
    /// Film points, mm.
    pub points: Vec<DVec2>,
    /// Their mean, mm.
    pub centroid: DVec2,
    /// Root mean square distance from the mean, mm.
    pub rms: f64,
    /// Largest distance from the mean, mm.
    pub geometric: f64,
    /// Fraction of a full grid over the lit rectangle that passes.
    pub passed: f64,
}

/// One ray of a fan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FanPoint {
    /// Place in the pupil, −1 to 1 between the outermost rays of the unvignetted axial beam.
    pub pupil: f64,
    /// Film point less the chief ray's, mm.
    pub error: DVec2,
    /// Optical path difference to the reference sphere, waves.
    pub opd: f64,
}

/// Rays along a line through the pupil.
#[derive(Clone, Debug)]
pub struct Fan {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Wavelength, nm.
    pub nm: f64,
    /// In the plane of the field.
    pub tangential: Vec<FanPoint>,
    /// Across it.
    pub sagittal: Vec<FanPoint>,
}

impl Spot {
    /// The spot of given film points, mm; `passed`: fraction of the grid that they are.
    pub fn of(points: Vec<DVec2>, field_deg: f64, nm: f64, passed: f64) -> Spot {
        let count = points.len().max(1) as f64;
        let centroid = points.iter().sum::<DVec2>() / count;
        let rms = (points.iter().map(|p| p.distance_squared(centroid)).sum::<f64>() / count).sqrt();
        let geometric = points.iter().map(|p| p.distance(centroid)).fold(0.0, f64::max);
        Spot { field_deg, nm, points, centroid, rms, geometric, passed }
    }

    /// Spot diagrams: a square a field, colours together, in µm around the centroid of the first colour.
    pub fn plot(title: &str, fields: &[Vec<Spot>]) -> Figure {
        spot_squares(title, &[fields.iter().map(|spots| (String::new(), spots.clone())).collect()])
    }

    /// Spot diagrams through focus: a row a field, its spots with the defocus (mm) of each square.
    pub fn plot_through_focus(title: &str, fields: &[Vec<(f64, Vec<Spot>)>]) -> Figure {
        let label = |(defocus, spots): &(f64, Vec<Spot>)| (format!("{defocus:+.3} mm: "), spots.clone());
        let rows: Vec<Vec<_>> = fields.iter().map(|row| row.iter().map(label).collect()).collect();
        spot_squares(title, &rows)
    }
}

impl Fan {
    /// Ray fans: tangential and sagittal transverse errors in µm, and the wavefront, a row a field.
    pub fn plot(title: &str, fields: &[Vec<Fan>]) -> Figure {
        let cell = DVec2::new(270.0, 190.0);
        let mut figure = Figure::sheet(title, 3, fields.len().max(1), cell);
        let all = || fields.iter().flatten();
        let errors =
            all().flat_map(|f| f.tangential.iter().map(|p| p.error.y * 1e3).chain(f.sagittal.iter().map(|p| p.error.x * 1e3)));
        let waves = all().flat_map(|f| f.tangential.iter().chain(&f.sagittal).map(|p| p.opd));
        let error_axis = Axis::around("transverse error, µm", errors, true);
        let wave_axis = Axis::around("path difference, waves", waves, true);
        for (row, fans) in fields.iter().enumerate() {
            let pupil = Axis { label: "relative pupil".into(), range: [-1.1, 1.1] };
            let kinds: [(&str, &Axis); 3] =
                [("tangential", &error_axis), ("sagittal", &error_axis), ("wavefront (full: tangential)", &wave_axis)];
            for (column, (kind, y)) in kinds.into_iter().enumerate() {
                let mut lines = vec![];
                for f in fans {
                    let color = wavelength_color(f.nm);
                    let name = if row == 0 && column == 0 { format!("{:.0} nm", f.nm) } else { String::new() };
                    let points = |p: &[FanPoint], value: &dyn Fn(&FanPoint) -> f64| {
                        p.iter().map(|p| DVec2::new(p.pupil, value(p))).collect::<Vec<_>>()
                    };
                    match column {
                        0 => lines.push(Line::new(name, color, Style::Full, points(&f.tangential, &|p| p.error.y * 1e3))),
                        1 => lines.push(Line::new(name, color, Style::Full, points(&f.sagittal, &|p| p.error.x * 1e3))),
                        _ => {
                            lines.push(Line::new(name, color, Style::Full, points(&f.tangential, &|p| p.opd)));
                            lines.push(Line::new(String::new(), color, Style::Broken, points(&f.sagittal, &|p| p.opd)));
                        }
                    }
                }
                let field = fans.first().map_or(0.0, |f| f.field_deg);
                let chart = Chart { title: format!("{field:.1}° {kind}"), x: pupil.clone(), y: y.clone(), lines };
                chart.draw(&mut figure, DVec2::new(cell.x * column as f64, 24.0 + cell.y * row as f64), cell);
            }
        }
        figure
    }
}

impl Bench<'_> {
    /// Spot of a field angle (degrees) and wavelength on a grid of `across` rays a side, `defocus` mm behind the film. The beam
    /// is that of `beam_nm`'s chief ray, so that spots of several colours lie in one frame. `None` where no light comes through.
    pub fn spot(&self, field_deg: f64, nm: f64, beam_nm: f64, across: usize, defocus: f64) -> Option<Spot> {
        let beam = self.beam(field_deg, beam_nm)?;
        let rays = self.grid(&beam, nm, across);
        if rays.is_empty() {
            return None;
        }
        let passed = rays.len() as f64 / (across * across) as f64;
        let points = rays.iter().map(|(_, r)| self.on_film(r, defocus)).collect();
        Some(Spot::of(points, field_deg, nm, passed))
    }

    /// The same with each ray somewhere in its cell of the pupil: a regular grid has contrast at frequencies of its own.
    pub(super) fn scattered_spot(&self, field_deg: f64, nm: f64, beam_nm: f64, across: usize, defocus: f64) -> Option<Spot> {
        let n = self.system.indices(nm);
        let points = self.scattered(field_deg, beam_nm, across, |ray| {
            let ray = self.system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip).ok()?;
            Some(self.on_film(&ray, defocus))
        })?;
        let passed = points.len() as f64 / (across * across) as f64;
        (!points.is_empty()).then(|| Spot::of(points, field_deg, nm, passed))
    }

    /// Film points (mm) of the same rays, and the fraction of its light that each keeps.
    pub(super) fn scattered_light(
        &self,
        field_deg: f64,
        nm: f64,
        beam_nm: f64,
        across: usize,
        defocus: f64,
    ) -> Option<Vec<(DVec2, f64)>> {
        let n = self.system.indices(nm);
        self.scattered(field_deg, beam_nm, across, |ray| {
            let (out, fraction) = self.system.trace_light(ray, &n, nm, TraceDirection::ToFilm).ok()?;
            Some((self.on_film(&out, defocus), fraction))
        })
    }

    /// What becomes of rays, each somewhere in its cell of the pupil, of those that pass; `None` of a field whose beam is not found.
    fn scattered<T>(
        &self,
        field_deg: f64,
        beam_nm: f64,
        across: usize,
        through: impl Fn(TracedRay) -> Option<T>,
    ) -> Option<Vec<T>> {
        let beam = self.beam(field_deg, beam_nm)?;
        let [low, high] = beam.extent;
        let cell = (high - low) / across as f64;
        // SplitMix64 of the cell number.
        let uniform = |i: usize| {
            let mut z = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let ray = |i: usize| {
            let place = DVec2::new((i % across) as f64 + uniform(2 * i), (i / across) as f64 + uniform(2 * i + 1));
            beam.ray(low + cell * place)
        };
        Some((0..across * across).filter_map(|i| through(ray(i))).collect())
    }

    /// Fans of a field angle (degrees): `count` rays each way, errors from the chief ray of `beam_nm`. `None` where no light
    /// comes through.
    pub fn fan(&self, field_deg: f64, nm: f64, beam_nm: f64, count: usize) -> Option<Fan> {
        let beam = self.beam(field_deg, beam_nm)?;
        let chief = self.on_film(&beam.image, 0.0);
        let reach = self.axial_reach(beam_nm)?;
        let n = self.system.indices(nm);
        let reference = self.reference_path(&beam, nm)?;
        let line = |tangential: bool| {
            (0..=2 * count)
                .filter_map(|i| {
                    let s = i as f64 / count as f64 - 1.0;
                    let at = if tangential { DVec2::new(0.0, s * reach) } else { DVec2::new(s * reach, 0.0) };
                    let out = self.system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip).ok()?;
                    let opd = self.opd(&beam, at, nm, &reference)?;
                    Some(FanPoint { pupil: s, error: self.on_film(&out, 0.0) - chief, opd })
                })
                .collect()
        };
        Some(Fan { field_deg, nm, tangential: line(true), sagittal: line(false) })
    }

    /// Radius of the axial beam across the chief ray, mm: what "relative pupil" counts in. `None` where no light comes through.
    pub fn axial_reach(&self, nm: f64) -> Option<f64> {
        let beam = self.beam(0.0, nm)?;
        let n = self.system.indices(nm);
        let passes =
            |r: f64| self.system.trace(beam.ray(DVec2::new(0.0, r)), &n, TraceDirection::ToFilm, Apertures::Clip).is_ok();
        // The extent is a grid cell too large; an obstruction in the middle does not matter.
        let mut high = beam.extent[1].y;
        let mut low = (1..=60).map(|i| high * (1.0 - i as f64 / 60.0)).find(|r| passes(*r)).unwrap_or(0.0);
        for _ in 0..50 {
            let mid = 0.5 * (low + high);
            if passes(mid) { low = mid } else { high = mid }
        }
        (low > 0.0).then_some(low * (1.0 - 1e-12))
    }

    /// Area of the lit pupil across the chief ray, mm².
    pub(super) fn lit_area(&self, beam: &Beam, nm: f64, across: usize) -> f64 {
        let [low, high] = beam.extent;
        let cell = (high - low) / across as f64;
        self.grid(beam, nm, across).len() as f64 * cell.x * cell.y
    }
}

/// Squares with a label each, all in one scale.
fn spot_squares(title: &str, rows: &[Vec<(String, Vec<Spot>)>]) -> Figure {
    let cell = DVec2::new(230.0, 240.0);
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let mut figure = Figure::sheet(title, columns, rows.len().max(1), cell);
    let all = rows.iter().flatten().flat_map(|(_, spots)| spots.iter());
    let reach = all.flat_map(|s| s.points.iter().map(|p| p.distance(s.centroid))).fold(1e-4, f64::max) * 1.1e3;
    let squares = rows.iter().enumerate().flat_map(|(j, row)| row.iter().enumerate().map(move |(i, square)| (i, j, square)));
    for (i, j, (label, spots)) in squares {
        let Some(first) = spots.first() else { continue };
        let at = |p: &DVec2| (*p - first.centroid) * 1e3;
        let lines = spots
            .iter()
            .map(|s| Line::new(format!("{:.0} nm", s.nm), wavelength_color(s.nm), Style::Dots, s.points.iter().map(at).collect()))
            .collect();
        let axis = |label: &str| Axis { label: label.into(), range: [-reach, reach] };
        let rms = spots.iter().map(|s| s.rms).fold(0.0, f64::max) * 1e3;
        let title = format!("{label}{:.1}°, {:.2} mm, RMS {rms:.1} µm", first.field_deg, first.centroid.y);
        let chart = Chart { title, x: axis("x, µm"), y: axis("y, µm"), lines };
        chart.draw(&mut figure, DVec2::new(cell.x * i as f64, 24.0 + cell.y * j as f64), cell);
    }
    figure
}
