//! Over the field: distortion, field curvature, vignetting and relative illumination, chromatic aberration (lateral colour; axial colour over wavelength).

use super::Bench;
use crate::draw::{Axis, Chart, FIELD_COLORS, Figure, Line, Style};
use crate::ray::{Apertures, TraceDirection, TracedRay};
use glam::DVec2;

/// What happens at a field point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPoint {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Chief ray on the film, mm.
    pub height: f64,
    /// Chief ray of field 0 on the film, mm: the origin of image heights. Not 0 where a group is decentred or tilted.
    pub axial_height: f64,
    /// How far from [`FieldPoint::axial_height`] an undistorted (rectilinear) image would put it, mm: f tan θ, moved along the chief ray
    /// by what the film is out of the paraxial focus. No number from 90° on, where no such image exists.
    pub ideal_height: f64,
    /// How far an equidistant image (the usual mapping of fisheyes) would put it, mm: f θ instead of f tan θ.
    pub equidistant_height: f64,
    /// Tangential and sagittal focus, mm behind the film (along the light), from rays close to the chief ray.
    pub focus: [f64; 2],
}

/// Image heights below this (mm) have no distortion: their ratio is that of rounding errors.
const SMALLEST_HEIGHT: f64 = 1e-6;

impl FieldPoint {
    /// Distortion, per cent of the ideal height, both from the image of the axis. NaN where the ideal height is below 1e-6 mm.
    pub fn distortion_percent(&self) -> f64 {
        self.departure_percent(self.ideal_height)
    }

    /// Departure from f θ, per cent of it; NaN where it is below 1e-6 mm.
    pub fn equidistant_percent(&self) -> f64 {
        self.departure_percent(self.equidistant_height)
    }

    fn departure_percent(&self, expected: f64) -> f64 {
        if expected.abs() < SMALLEST_HEIGHT {
            return f64::NAN;
        }
        ((self.height - self.axial_height) / expected - 1.0) * 100.0
    }

    /// Distortion and field curvature over the field.
    pub fn plot(title: &str, points: &[FieldPoint]) -> Figure {
        let cell = DVec2::new(300.0, 330.0);
        let mut figure = Figure::sheet(title, 2, 1, cell);
        let field = Axis { label: "field angle, degrees".into(), range: [0.0, points.last().map_or(1.0, |p| p.field_deg)] };
        let over =
            |value: &dyn Fn(&FieldPoint) -> f64| points.iter().map(|p| DVec2::new(value(p), p.field_deg)).collect::<Vec<_>>();
        // Against f tan θ there is none from 90° on; a lens that is nearer to f θ (a fisheye) is held against that too.
        let finite = |points: Vec<DVec2>| points.into_iter().filter(|p| p.x.is_finite()).collect::<Vec<_>>();
        let (rectilinear, equidistant) = (finite(over(&|p| p.distortion_percent())), finite(over(&|p| p.equidistant_percent())));
        let edge = |v: &[DVec2]| v.last().map_or(0.0, |p| p.x.abs());
        let beyond = points.iter().any(|p| p.ideal_height.is_nan());
        let fisheye = beyond || edge(&rectilinear) > edge(&equidistant).max(5.0);
        let (shown, label) = if fisheye { (equidistant.clone(), "departure, %") } else { (rectilinear.clone(), "distortion, %") };
        let reach = if fisheye { shown.iter().chain(&rectilinear) } else { shown.iter().chain(&shown[..0]) };
        let x = Axis::around(label, reach.map(|p| p.x), true);
        let lines = match fisheye {
            false => vec![Line::new(String::new(), FIELD_COLORS[0], Style::Full, rectilinear)],
            true => vec![
                Line::new("from f θ".into(), FIELD_COLORS[0], Style::Full, equidistant),
                Line::new("from f tan θ".into(), FIELD_COLORS[2], Style::Broken, rectilinear),
            ],
        };
        Chart { title: "distortion".into(), x, y: field.clone(), lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        let (t, s) = (over(&|p| p.focus[0]), over(&|p| p.focus[1]));
        let x = Axis::around("focus behind the film, mm", t.iter().chain(&s).map(|p| p.x), true);
        let lines = vec![
            Line::new("tangential".into(), FIELD_COLORS[2], Style::Full, t),
            Line::new("sagittal".into(), FIELD_COLORS[0], Style::Broken, s),
        ];
        Chart { title: "field curvature".into(), x, y: field, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
        figure
    }
}

/// Light at a film height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Illumination {
    /// Distance from the axis on the film, mm.
    pub height: f64,
    /// Irradiance over radiance, sr: ∫ cosθ dω over what passes; no losses in glass.
    pub geometric: f64,
    /// The same with losses in glass and at surfaces.
    pub with_losses: f64,
}

/// Shape of the pupils as one field point sees them.
#[derive(Clone, Debug)]
pub struct PupilShape {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Edge of the entrance pupil across the chief ray: sagittal, tangential, mm from the chief ray.
    pub entrance: Vec<DVec2>,
    /// The same rays in the plane of the paraxial exit pupil, mm from the axis.
    pub exit: Vec<DVec2>,
}

/// Colour over wavelength.
#[derive(Clone, Debug)]
pub struct ColorCurves {
    /// nm.
    pub wavelengths: Vec<f64>,
    /// Paraxial focus behind that of the reference, mm.
    pub axial: Vec<f64>,
    /// For each field (degrees): chief ray height less that of the reference wavelength, mm.
    pub lateral: Vec<(f64, Vec<f64>)>,
}

impl Illumination {
    /// Relative illumination over the film, mechanical vignetting over the field, and the entrance pupil as fields see it.
    pub fn plot(title: &str, light: &[Illumination], vignetting: &[(f64, f64)], pupils: &[PupilShape]) -> Figure {
        let cell = DVec2::new(300.0, 300.0);
        let mut figure = Figure::sheet(title, 3, 1, cell);
        let reach = pupils.iter().flat_map(|p| p.entrance.iter().map(|p| p.abs().max_element())).fold(1e-9, f64::max) * 1.1;
        let outlines = pupils
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let closed = p.entrance.iter().chain(p.entrance.first()).copied().collect();
                Line::new(format!("{:.1}°", p.field_deg), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, closed)
            })
            .collect();
        let axis = |label: &str| Axis { label: label.into(), range: [-reach, reach] };
        Chart { title: "entrance pupil".into(), x: axis("sagittal, mm"), y: axis("tangential, mm"), lines: outlines }.draw(
            &mut figure,
            DVec2::new(2.0 * cell.x, 24.0),
            cell,
        );
        let y = Axis { label: "fraction of the axis".into(), range: [0.0, 1.05] };
        let axis = light.first().copied().unwrap_or(Illumination { height: 0.0, geometric: 1.0, with_losses: 1.0 });
        let over =
            |value: &dyn Fn(&Illumination) -> f64| light.iter().map(|l| DVec2::new(l.height, value(l))).collect::<Vec<_>>();
        let lines = vec![
            Line::new("illumination".into(), FIELD_COLORS[0], Style::Full, over(&|l| l.geometric / axis.geometric.max(1e-300))),
            Line::new(
                "with losses".into(),
                FIELD_COLORS[2],
                Style::Broken,
                over(&|l| l.with_losses / axis.with_losses.max(1e-300)),
            ),
        ];
        let x = Axis { label: "image height, mm".into(), range: [0.0, light.last().map_or(1.0, |l| l.height)] };
        Chart { title: "relative illumination".into(), x, y: y.clone(), lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        let points = vignetting.iter().map(|(f, v)| DVec2::new(*f, *v)).collect();
        let lines = vec![Line::new(String::new(), FIELD_COLORS[1], Style::Full, points)];
        let x = Axis { label: "field angle, degrees".into(), range: [0.0, vignetting.last().map_or(1.0, |v| v.0)] };
        Chart { title: "beam area across the chief ray".into(), x, y, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
        figure
    }
}

impl ColorCurves {
    /// Axial and lateral colour over wavelength.
    pub fn plot(&self, title: &str) -> Figure {
        let cell = DVec2::new(330.0, 280.0);
        let mut figure = Figure::sheet(title, 2, 1, cell);
        let (first, last) =
            (self.wavelengths.first().copied().unwrap_or(400.0), self.wavelengths.last().copied().unwrap_or(700.0));
        let x = Axis { label: "wavelength, nm".into(), range: [first, last] };
        let over =
            |v: &[f64], scale: f64| self.wavelengths.iter().zip(v).map(|(w, v)| DVec2::new(*w, *v * scale)).collect::<Vec<_>>();
        let axial = over(&self.axial, 1.0);
        let y = Axis::around("paraxial focus, mm", axial.iter().map(|p| p.y), true);
        let lines = vec![Line::new(String::new(), FIELD_COLORS[0], Style::Full, axial)];
        Chart { title: "axial colour".into(), x: x.clone(), y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
        let lines: Vec<Line> = self
            .lateral
            .iter()
            .enumerate()
            .map(|(i, (field, v))| {
                Line::new(format!("{field:.1}°"), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, over(v, 1e3))
            })
            .collect();
        let y = Axis::around("image height, µm", lines.iter().flat_map(|l| l.points.iter().map(|p| p.y)), true);
        Chart { title: "lateral colour".into(), x, y, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
        figure
    }
}

impl Bench<'_> {
    /// A field point at a wavelength. `None` where no chief ray comes through.
    pub fn field_point(&self, field_deg: f64, nm: f64) -> Option<FieldPoint> {
        let n = self.system.indices(nm);
        let beam = self.chief_beam(field_deg, nm)?;
        let first = self.first_order(nm);
        let image = beam.image;
        let height = self.on_film(&image, 0.0).y;
        let slope_of = |ray: &TracedRay| ray.direction.y / ray.direction.z;
        // Heights count from the image of the axis, which a decentred group moves.
        let (axial_height, axial_slope) = match self.system.is_centered() {
            true => (0.0, 0.0),
            false => {
                let axial = self.chief_beam(0.0, nm)?.image;
                (self.on_film(&axial, 0.0).y, slope_of(&axial))
            }
        };
        let slope = slope_of(&image) - axial_slope;
        let angle = field_deg.to_radians();
        let tan = if angle.abs() < std::f64::consts::FRAC_PI_2 - 1e-9 { angle.tan() } else { f64::NAN };
        // Height of an image that maps angles to f `mapped`.
        let image_height = |mapped: f64| match self.object_distance {
            None => {
                let out = self.system.film_z - self.system.last_z() - first.bfl;
                first.front_focal_length() * mapped + slope * out
            }
            Some(d) => {
                // By the magnification of the paraxial conjugate.
                let m = first.front_focal_length() / (d + first.ffl);
                let image_z = self.system.last_z() + first.bfl + first.efl * m * self.system.film_run();
                // The object lies where the chief ray comes from, which aims at the pupil as this field sees it.
                m * mapped * (d + beam.pupil.z) + slope * (self.system.film_z - image_z)
            }
        };
        let (ideal_height, equidistant_height) = (image_height(tan), image_height(angle));
        // Two rays beside the chief ray meet where their distance is zero.
        let small = 1e-3 * first.entrance_pupil_radius().max(1e-3);
        let meet = |offset: DVec2, along_y: bool| {
            let trace = |at: DVec2| self.system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Ignore).ok();
            let (a, b) = (trace(offset)?, trace(-offset)?);
            let z = self.system.film_z;
            let part = |r: &TracedRay| {
                let p = crate::trace::at_plane(r, z);
                if along_y { (p.y, r.direction.y / r.direction.z) } else { (p.x, r.direction.x / r.direction.z) }
            };
            let ((pa, sa), (pb, sb)) = (part(&a), part(&b));
            Some(-(pa - pb) / (sa - sb) * self.system.film_run())
        };
        let focus = [meet(DVec2::new(0.0, small), true)?, meet(DVec2::new(small, 0.0), false)?];
        Some(FieldPoint { field_deg, height, axial_height, ideal_height, equidistant_height, focus })
    }

    /// Light at a film point at a height (mm) above the axis, by tracing from the film.
    pub fn illumination(&self, height: f64, nm: f64) -> Illumination {
        let n = self.system.indices(nm);
        let film = DVec2::new(0.0, height).extend(self.system.film_z);
        let Some(rim) = self.system.surfaces.last() else {
            return Illumination { height, geometric: 0.0, with_losses: 0.0 };
        };
        let ray = |s: DVec2| TracedRay { position: film, direction: self.system.film_direction(s) };
        let lit = |low: DVec2, high: DVec2, side: usize| {
            let cell = (high - low) / side as f64;
            let (mut lit_low, mut lit_high) = (DVec2::MAX, DVec2::MIN);
            for i in 0..side * side {
                let s = low + cell * DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
                if self.system.trace(ray(s), &n, TraceDirection::ToObject, Apertures::Clip).is_ok() {
                    (lit_low, lit_high) = (lit_low.min(s), lit_high.max(s));
                }
            }
            // A disk that holds one point of the grid alone reaches up to 1.4 cells beyond it.
            (lit_low.x <= lit_high.x).then(|| (lit_low - 2.0 * cell, lit_high + 2.0 * cell))
        };
        // Where the paraxial exit pupil is seen; else anywhere on the rim of the last surface, more and more finely.
        let first = self.first_order(nm);
        let run = self.system.film_run();
        let away = (self.system.film_z - first.exit_pupil_z) * run;
        let center = -film.truncate() / away + self.system.base_slope(&n);
        let half = 2.0 * first.exit_pupil_radius() / away.abs();
        let sag = rim.profile.sag(0.0, rim.semi_diameter * (1.0 - 1e-9)).unwrap_or(0.0);
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        for d in [(self.system.film_z - rim.z) * run, (self.system.film_z - rim.z - sag) * run] {
            for corner in [DVec2::splat(-1.0), DVec2::splat(1.0)] {
                let s = (corner * rim.semi_diameter - film.truncate()) / d;
                (low, high) = (low.min(s), high.max(s));
            }
        }
        let found = Some((center - half, center + half))
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .and_then(|(a, b)| {
                let (a, b) = lit(a, b, 48)?;
                // What reaches the edge of where it was looked for may go on beyond.
                (a.cmpgt(center - half).all() && b.cmplt(center + half).all()).then_some((a, b))
            })
            .or_else(|| [48, 192, 600].into_iter().find_map(|side| lit(low, high, side)));
        let Some((a, b)) = found else {
            return Illumination { height, geometric: 0.0, with_losses: 0.0 };
        };
        (low, high) = lit(a, b, 64).unwrap_or((a, b));
        const SIDE: usize = 160;
        let gain = self.system.film_index(&n).powi(2);
        let cell = (high - low) / SIDE as f64;
        let (mut geometric, mut with_losses) = (0.0, 0.0);
        for i in 0..SIDE * SIDE {
            let s = low + cell * DVec2::new((i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5);
            let r = ray(s);
            if let Ok(fraction) = self.system.transmittance(r, &n, nm, TraceDirection::ToObject) {
                let part = cell.x * cell.y * r.direction.z.powi(4) * gain;
                geometric += part;
                with_losses += part * fraction;
            }
        }
        Illumination { height, geometric, with_losses }
    }

    /// Fraction of the axial beam's area that a field's beam keeps: mechanical vignetting. `None` where no light comes through on the axis.
    pub fn vignetting(&self, field_deg: f64, nm: f64) -> Option<f64> {
        let (axis, beam) = (self.beam(0.0, nm)?, self.beam(field_deg, nm));
        let full = self.lit_area(&axis, nm, 96);
        Some(beam.map_or(0.0, |b| self.lit_area(&b, nm, 96)) / full)
    }

    /// Shape of both pupils for a field angle (degrees), by the rays that just pass. `None` where no light comes through.
    pub fn pupil_shape(&self, field_deg: f64, nm: f64) -> Option<PupilShape> {
        let beam = self.beam(field_deg, nm)?;
        let n = self.system.indices(nm);
        let exit_z = self.first_order(nm).exit_pupil_z;
        let lit = self.grid(&beam, nm, 41);
        let center = lit.iter().map(|r| r.0).sum::<DVec2>() / lit.len().max(1) as f64;
        let reach = (beam.extent[1] - beam.extent[0]).length();
        let trace = |at: DVec2| self.system.trace(beam.ray(at), &n, TraceDirection::ToFilm, Apertures::Clip).ok();
        let (mut entrance, mut exit) = (vec![], vec![]);
        for i in 0..72 {
            let direction = DVec2::from_angle(std::f64::consts::TAU * i as f64 / 72.0);
            // From outside inwards: an obstruction in the middle is not the edge.
            let steps = 80;
            let Some(last) = (0..=steps).rev().find(|k| trace(center + direction * (reach * *k as f64 / steps as f64)).is_some())
            else {
                continue;
            };
            let (mut low, mut high) = (reach * last as f64 / steps as f64, reach * (last + 1) as f64 / steps as f64);
            for _ in 0..30 {
                let mid = 0.5 * (low + high);
                if trace(center + direction * mid).is_some() { low = mid } else { high = mid }
            }
            let at = center + direction * low;
            entrance.push(at);
            if let Some(ray) = trace(at) {
                exit.push(crate::trace::at_plane(&ray, exit_z).truncate());
            }
        }
        Some(PupilShape { field_deg, entrance, exit })
    }

    /// Axial colour, and lateral colour at some fields (degrees).
    pub fn color(&self, wavelengths: &[f64], reference_nm: f64, fields_deg: &[f64]) -> ColorCurves {
        // Where the axial point of the object is imaged, from the last vertex.
        let focus = |nm: f64| {
            let image = match self.object_distance.filter(|_| self.system.object_axis.is_none()) {
                None => self.first_order(nm).bfl,
                Some(d) => {
                    let (y, u) = crate::paraxial::Trace::new(self.system, &self.system.indices(nm), d, 1.0).last();
                    -y / u
                }
            };
            image * self.system.film_run()
        };
        let height = |field: f64, nm: f64| self.chief_beam(field, nm).map(|b| self.on_film(&b.image, 0.0).y);
        let lateral = |field: f64| {
            let reference = height(field, reference_nm);
            let each = |nm: &f64| Some(height(field, *nm)? - reference?);
            (field, wavelengths.iter().map(|nm| each(nm).unwrap_or(f64::NAN)).collect())
        };
        ColorCurves {
            wavelengths: wavelengths.to_vec(),
            axial: wavelengths.iter().map(|nm| focus(*nm) - focus(reference_nm)).collect(),
            lateral: fields_deg.iter().map(|f| lateral(*f)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embedded;
    use crate::glass::D_NM;
    use crate::prescription::Misalignment;
    use crate::system::{State, System};

    #[test]
    fn a_decentred_lens_is_held_against_the_image_of_the_axis() {
        let plain = embedded("double-gauss-50mm").unwrap();
        let mut moved = plain.clone();
        let last = plain.surfaces.len() - 1;
        moved.misalignments.push(Misalignment { first: 0, last, decenter: [0.0, 2.0, 0.0], tilt: [0.0; 3] });
        let [plain, moved] = [plain, moved].map(|p| System::at(&p, State::default()));
        for object_distance in [None, Some(1500.0)] {
            let point = |system: &System, field: f64| Bench { system, object_distance }.field_point(field, D_NM).unwrap();
            for field in [-15.0, 3.0, 15.0] {
                // All of the lens moved by 2 mm: the picture moves with it and keeps its distortion.
                let (a, b) = (point(&plain, field), point(&moved, field));
                assert!((b.axial_height - 2.0).abs() < 1e-7 && (b.height - a.height - 2.0).abs() < 1e-7, "{a:?} {b:?}");
                assert!((a.distortion_percent() - b.distortion_percent()).abs() < 1e-5, "{a:?} {b:?}");
                assert!((a.equidistant_percent() - b.equidistant_percent()).abs() < 1e-5, "{a:?} {b:?}");
            }
            // The axis has no distortion, not one of rounding errors.
            for system in [&plain, &moved] {
                let axis = point(system, 0.0);
                assert!(axis.distortion_percent().is_nan() && axis.equidistant_percent().is_nan(), "{axis:?}");
            }
        }
    }

    #[test]
    fn fisheyes_are_held_against_f_theta() {
        let system = System::at(&embedded("fisheye-10mm").unwrap(), State::default());
        let bench = Bench::at_infinity(&system);
        let f = bench.first_order(D_NM).efl;
        for field in [10.0f64, 45.0, 60.0] {
            let p = bench.field_point(field, D_NM).unwrap();
            // The film stands in the paraxial focus: nothing is added to f θ and f tan θ.
            let out = system.film_z - system.last_z() - bench.first_order(D_NM).bfl;
            assert!((p.equidistant_height - f * field.to_radians()).abs() < 1e-9 + 2.0 * out.abs(), "{p:?} {f} {out}");
            assert!((p.ideal_height - f * field.to_radians().tan()).abs() < 1e-9 + 2.0 * out.abs(), "{p:?} {f} {out}");
            assert!(p.equidistant_percent().abs() < p.distortion_percent().abs(), "{p:?}");
        }
        // 60° off the axis f tan θ is 65 % more than f θ.
        let p = bench.field_point(60.0, D_NM).unwrap();
        assert!(p.equidistant_percent().abs() < 1.0 && p.distortion_percent() < -35.0, "{p:?}");
    }

    #[test]
    fn images_within_glass_have_no_distortion_near_the_axis() {
        // A single surface, R = 10, glass to the film at its focus: f' = 30, 1 / power 20. The stop is at the centre: chief rays go straight on.
        let text = "name = \"ball\"\nsurfaces = [\n{ radius = 10, gap = 10, glass = \"1.5\", semi_diameter = 4 },\n\
                    { stop = true, gap = 20, glass = \"1.5\", semi_diameter = 2 } ]";
        let p = crate::prescription::read_toml(text, "ball").unwrap();
        let system = System::at(&p, State::default());
        let bench = Bench::at_infinity(&system);
        let first = bench.first_order(D_NM);
        assert!((first.efl - 30.0).abs() < 1e-9 && (first.front_focal_length() - 20.0).abs() < 1e-9, "{first:?}");
        assert!((first.front_principal_z - 0.0).abs() < 1e-9, "{first:?}");
        let point = bench.field_point(1.0, D_NM).unwrap();
        assert!(point.distortion_percent().abs() < 0.05, "{point:?}");
    }
}
