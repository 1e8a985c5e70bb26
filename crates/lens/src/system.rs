//! A prescription at one focus and zoom: surfaces at their places, ready to be traced.

use crate::Blocked;
use crate::aperture::Aperture;
use crate::coating::film::{aluminium, fresnel, quarter_wave};
use crate::coating::{self, Coating, SurfaceCoating};
use crate::diffractive::Diffractive;
use crate::glare::Finish;
use crate::glass::{D_NM, Glass};
use crate::gradient::{GradedRay, Gradient};
use crate::iris::Iris;
use crate::prescription::Prescription;
use crate::ray::{Apertures, TraceDirection, TracedRay};
use crate::surface::Profile;
use glam::{DAffine3, DMat3, DVec2, DVec3, EulerRot};

/// Wavelength at which rays without one are traced, nm.
pub const REFERENCE_NM: f64 = D_NM;

/// Where focus and zoom stand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Zoom position: 0 the first, fractions between the printed ones.
    pub zoom: f64,
    /// 0 infinity, 1 the close position, of a lens that has gaps for it.
    pub focus: f64,
}

/// A surface in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedSurface {
    /// Shape.
    pub profile: Profile,
    /// Vertex on the axis, mm from the first vertex.
    pub z: f64,
    /// Half the clear diameter, mm.
    pub semi_diameter: f64,
    /// Half the diameter of what is blocked in the middle, mm.
    pub obstruction: f64,
    /// What else limits or blocks the light.
    pub apertures: Vec<Aperture>,
    /// Reflects.
    pub mirror: bool,
    /// Of an ideal thin lens in this plane, mm.
    pub ideal_focal_length: Option<f64>,
    /// Phase on it.
    pub diffractive: Option<Diffractive>,
    /// What is on it.
    pub coating: SurfaceCoating,
    /// How it scatters.
    pub finish: Finish,
    /// Local frame where it is not simply moved to z: lens from local, and back.
    pub frame: Option<Box<(DAffine3, DAffine3)>>,
}

impl PlacedSurface {
    /// Into the surface's own frame.
    #[inline]
    pub fn to_local(&self, point: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        match &self.frame {
            None => (DVec3::new(point.x, point.y, point.z - self.z), direction),
            Some(f) => (f.1.transform_point3(point), f.1.transform_vector3(direction)),
        }
    }

    /// Back into the lens's.
    #[inline]
    pub fn to_lens(&self, point: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        match &self.frame {
            None => (DVec3::new(point.x, point.y, point.z + self.z), direction),
            Some(f) => (f.0.transform_point3(point), f.0.transform_vector3(direction)),
        }
    }

    /// The lens's y across the axis of the surface, in the surface's own frame: how far it is turned about that axis. A unit vector.
    pub(crate) fn upwards(&self) -> DVec2 {
        match &self.frame {
            None => DVec2::Y,
            Some(f) => f.1.transform_vector3(DVec3::Y).truncate().normalize_or(DVec2::Y),
        }
    }

    /// Curvature at the vertex in the lens's y–z section, 1/mm: of a surface with two by Euler's theorem as it is turned about its axis. How it is tilted does not count.
    pub(crate) fn section_curvature(&self) -> f64 {
        let up = self.upwards();
        match self.frame.is_none() {
            true => self.profile.curvature(),
            false => self.profile.curvature_x() * up.x * up.x + self.profile.curvature() * up.y * up.y,
        }
    }

    /// Whether the rim and all apertures let a local point pass.
    #[inline]
    pub fn lets_through(&self, x: f64, y: f64) -> bool {
        let r2 = x * x + y * y;
        r2 <= self.semi_diameter * self.semi_diameter
            && r2 >= self.obstruction * self.obstruction
            && self.apertures.iter().all(|a| a.lets_through(x, y))
    }

    /// Lower and upper corner of a rectangle in its own x and y that holds all that rim and openings let through, mm.
    pub fn bounds(&self) -> [DVec2; 2] {
        let rim = DVec2::splat(self.semi_diameter);
        self.apertures
            .iter()
            .filter_map(Aperture::bounds)
            .fold([-rim, rim], |[low, high], [a, b]| [low.max(DVec2::from_array(a)), high.min(DVec2::from_array(b))])
    }

    /// Circle in its own x and y that holds all that rim and openings let through: its middle, and its radius, mm. The rim itself but for a part off the vertex.
    pub(crate) fn clear_circle(&self) -> (DVec2, f64) {
        let [low, high] = self.bounds();
        match (low + high).length() > 1e-9 * self.semi_diameter {
            true => (0.5 * (low + high), 0.5 * (high - low).length()),
            false => (DVec2::ZERO, self.semi_diameter),
        }
    }

    /// Middle of what rim and openings let through, in lens space, mm.
    fn middle(&self) -> DVec3 {
        let (at, _) = self.clear_circle();
        self.to_lens(at.extend(self.profile.sag(at.x, at.y).unwrap_or(0.0)), DVec3::Z).0
    }

    /// Whether something inside its rim blocks light.
    pub fn is_obscured(&self) -> bool {
        self.obstruction > 0.0 || self.apertures.iter().any(Aperture::blocks)
    }
}

/// The opening of the stop.
#[derive(Clone, Debug, PartialEq)]
pub struct StopOpening {
    /// Shape.
    pub shape: Iris,
    /// Radius of the disk of equal area, mm.
    pub radius: f64,
}

impl StopOpening {
    /// Fraction of light that a place of the stop lets through, 0 to 1.
    #[inline]
    pub fn transmittance(&self, x: f64, y: f64) -> f64 {
        self.shape.transmittance(x / self.radius, y / self.radius) as f64
    }
}

/// Surfaces in their places, from the object to the film.
#[derive(Clone, Debug, PartialEq)]
pub struct System {
    /// In the order in which light meets them.
    pub surfaces: Vec<PlacedSurface>,
    /// What fills each gap: before the first surface, after the first, ... after the last.
    pub glasses: Vec<Glass>,
    /// How the index of each gap departs from its glass's, in the frame of the surface before it.
    pub gradients: Vec<Option<Gradient>>,
    /// +1 where light runs along +z in a gap, −1 where a mirror has turned it.
    pub runs: Vec<f64>,
    /// Number of the stop.
    pub stop: usize,
    /// Its opening.
    pub iris: StopOpening,
    /// Axis of the object: lens from object, and back, where it is not the lens's ([`crate::prescription::ObjectAxis`]).
    pub object_axis: Option<Box<(DAffine3, DAffine3)>>,
    /// Where the film stands, mm from the first vertex.
    pub film_z: f64,
    /// What barrel, edges and blades throw back of the light that meets them, 0 to 1.
    pub wall_reflectance: f64,
}

impl System {
    /// The lens at a focus and zoom, the stop fully open. Missing semi-diameters count as very large (they are inferred when
    /// a prescription is checked).
    pub fn at(p: &Prescription, state: State) -> System {
        let mut z = 0.0;
        let mut run = 1.0;
        let (mut surfaces, mut glasses, mut runs) = (vec![], vec![Glass::air()], vec![1.0]);
        let mut gradients = vec![None];
        for s in &p.surfaces {
            let own = (s.decenter != [0.0; 2] || s.tilt != [0.0; 3]).then(|| place(s.decenter[0], s.decenter[1], z, s.tilt));
            let before = glasses.last().unwrap_or(&s.glass);
            let coating = match &s.coating {
                // There is nothing that could reflect.
                _ if s.ideal_focal_length.is_some() => SurfaceCoating::Perfect,
                Some(own) => own.on(before, &s.glass, s.mirror, true),
                None => p.coating.on(before, &s.glass, s.mirror, false),
            };
            surfaces.push(PlacedSurface {
                profile: s.profile.clone(),
                z,
                semi_diameter: s.semi_diameter.unwrap_or(1e9),
                obstruction: s.obstruction,
                apertures: s.apertures.clone(),
                mirror: s.mirror,
                ideal_focal_length: s.ideal_focal_length,
                diffractive: s.diffractive.clone(),
                coating,
                finish: s.finish.unwrap_or(p.finish),
                frame: own.map(|f| Box::new((f, f.inverse()))),
            });
            if s.mirror {
                run = -run;
            }
            glasses.push(s.glass.clone());
            gradients.push(s.gradient.clone());
            runs.push(run);
            z += s.gap.at(state.zoom, state.focus);
        }
        for m in &p.misalignments {
            let first: &PlacedSurface = &surfaces[m.first];
            let pivot = match (&p.object_axis, &first.frame) {
                // Off the axis it turns about the middle of what is used of it, once it stands in its place.
                (Some(_), Some(_)) => first.middle(),
                _ => DVec3::Z * first.z,
            };
            let to = pivot + DVec3::from_array(m.decenter);
            let moved = place(to.x, to.y, to.z, m.tilt) * DAffine3::from_translation(-pivot);
            for s in &mut surfaces[m.first..=m.last] {
                let before = s.frame.as_ref().map_or(DAffine3::from_translation(DVec3::new(0.0, 0.0, s.z)), |f| f.0);
                let frame = moved * before;
                s.frame = Some(Box::new((frame, frame.inverse())));
            }
        }
        let stop = p.stop();
        let iris = StopOpening { shape: p.iris.clone(), radius: surfaces[stop].semi_diameter };
        System {
            surfaces,
            glasses,
            gradients,
            runs,
            stop,
            iris,
            object_axis: p.object_axis.as_ref().map(|a| {
                let frame = place(a.decenter[0], a.decenter[1], a.decenter[2], a.tilt);
                Box::new((frame, frame.inverse()))
            }),
            film_z: z + p.usage.defocus,
            wall_reflectance: p.wall_reflectance,
        }
    }

    /// Puts another coating on all surfaces, whatever they had.
    pub fn recoat(&mut self, coating: &Coating) {
        for (surface, media) in self.surfaces.iter_mut().zip(self.glasses.windows(2)) {
            if surface.ideal_focal_length.is_none() {
                surface.coating = coating.on(&media[0], &media[1], surface.mirror, false);
            }
        }
    }

    /// Index of every gap at a wavelength; of a lens with diffractive surfaces the wavelength itself behind them, mm.
    pub fn indices(&self, nm: f64) -> Vec<f64> {
        let wavelength = self.has_diffractive().then_some(nm * 1e-6);
        self.glasses.iter().map(|g| g.index(nm)).chain(wavelength).collect()
    }

    /// Index of what the film stands in, by [`System::indices`]: 1 in air. Radiance over its square is kept along a ray, and waves are shorter by it.
    pub fn film_index(&self, n: &[f64]) -> f64 {
        n.get(self.surfaces.len()).map_or(1.0, |n| n.abs())
    }

    /// A wavelength (nm), or where a glass has no index there the shortest one from it on at which all have one.
    pub(crate) fn nearest_with_indices(&self, nm: f64) -> f64 {
        if self.indices(nm).iter().all(|n| n.is_finite()) {
            return nm;
        }
        let begins = self.glasses.iter().filter_map(|g| g.range_nm()).map(|[short, _]| short);
        begins.fold(nm, f64::max)
    }

    /// Indices at the wavelength at which focal lengths, f-numbers and film planes are found: [`REFERENCE_NM`], or where a glass is opaque there (germanium), the shortest
    /// at which the ranges of all begin.
    pub fn reference_indices(&self) -> Vec<f64> {
        self.indices(self.nearest_with_indices(REFERENCE_NM))
    }

    /// The first glass without an index at 400, 410, ... 700 nm, in which all visible light ends (germanium).
    pub fn dark_glass(&self) -> Option<&Glass> {
        self.glasses.iter().find(|g| (40..=70).all(|i| !g.index(f64::from(10 * i)).is_finite()))
    }

    /// Whether any surface carries a phase.
    pub fn has_diffractive(&self) -> bool {
        self.surfaces.iter().any(|s| s.diffractive.is_some())
    }

    /// The wavelength (mm) that goes with [`System::indices`], of a lens with diffractive surfaces.
    #[inline]
    pub(crate) fn wavelength_mm(&self, n: &[f64]) -> f64 {
        n[self.surfaces.len() + 1]
    }

    /// Fraction of the light of a wavelength (nm) that the phase of a surface sends into an order: [`Diffractive::efficiency`]. 1 for the order 0 of a
    /// surface without a phase.
    pub fn diffraction_efficiency(&self, surface: usize, order: i32, nm: f64) -> f64 {
        let Some(phase) = &self.surfaces[surface].diffractive else { return if order == 0 { 1.0 } else { 0.0 } };
        let at = |nm: f64| self.relief_step(surface, [self.glasses[surface].index(nm), self.glasses[surface + 1].index(nm)]);
        phase.efficiency(order, nm, [at(nm), self.blaze_step(surface)])
    }

    /// What a height of glass adds to the path at a surface, for each unit.
    fn relief_step(&self, surface: usize, n: [f64; 2]) -> f64 {
        if self.surfaces[surface].mirror { 2.0 * n[0] } else { n[1] - n[0] }
    }

    /// The same at the wavelength of the blaze of a surface; 0 without one.
    pub(crate) fn blaze_step(&self, surface: usize) -> f64 {
        let blaze = self.surfaces[surface].diffractive.as_ref().and_then(Diffractive::blaze);
        blaze.map_or(0.0, |b| self.relief_step(surface, [surface, surface + 1].map(|gap| self.glasses[gap].index(b.nm))))
    }

    /// Absorption of every gap at a wavelength, 1/mm.
    pub fn absorption(&self, nm: f64) -> Vec<f64> {
        self.glasses.iter().map(|g| g.absorption(nm)).collect()
    }

    /// Whether the lens, but for its iris, looks the same from all sides of the axis.
    pub fn is_rotational(&self) -> bool {
        self.object_axis.is_none()
            && self.surfaces.iter().all(|s| {
                let round = s.diffractive.as_ref().is_none_or(|d| d.phase().is_rotational());
                s.frame.is_none() && s.profile.is_rotational() && s.apertures.is_empty() && round
            })
    }

    /// Fraction of unpolarised light that one surface lets on, by the indices before and after it along the light (`n`) and the cosines of
    /// incidence and refraction.
    pub fn surface_transmittance(&self, surface: usize, way: TraceDirection, n: [f64; 2], cosines: [f64; 2], nm: f64) -> f64 {
        let surface = &self.surfaces[surface];
        if surface.mirror {
            return match &surface.coating {
                SurfaceCoating::Layers(stack) => coating::on_aluminium(stack, n[0], cosines[0], nm).unpolarised_reflectance(),
                _ => aluminium(nm),
            };
        }
        match &surface.coating {
            SurfaceCoating::Layers(stack) => stack.response(way, n[0], n[1].into(), cosines[0], nm).unpolarised_transmittance(),
            _ if n[0] == n[1] => 1.0,
            SurfaceCoating::Perfect => 1.0,
            SurfaceCoating::Flat(reflectance) => 1.0 - reflectance,
            SurfaceCoating::QuarterWave => quarter_wave(n[0], n[1], cosines, nm),
            SurfaceCoating::Bare => fresnel(n[0], n[1], cosines),
        }
    }

    /// Fraction of unpolarised light that one surface throws back, by the indices before and after it along the light (`n`) and the cosine
    /// of incidence; all of it where the law of refraction has no solution. Mirrors as [`System::surface_transmittance`].
    pub fn surface_reflectance(&self, surface: usize, way: TraceDirection, n: [f64; 2], cos: f64, nm: f64) -> f64 {
        let placed = &self.surfaces[surface];
        if let (SurfaceCoating::Layers(stack), false) = (&placed.coating, placed.mirror) {
            return stack.response(way, n[0], n[1].into(), cos, nm).unpolarised_reflectance();
        }
        let cos2 = 1.0 - (n[0] / n[1]).powi(2) * (1.0 - cos * cos);
        if cos2 <= 0.0 && !placed.mirror {
            return 1.0;
        }
        let through = self.surface_transmittance(surface, way, n, [cos, cos2.max(0.0).sqrt()], nm);
        if placed.mirror { through } else { 1.0 - through }
    }

    /// Whether the index of any gap depends on the place.
    pub fn has_gradients(&self) -> bool {
        self.gradients.iter().any(Option::is_some)
    }

    /// Index of a gap at a point in lens space; `n`: that of its glass.
    pub(crate) fn index_at(&self, gap: usize, n: f64, point: DVec3) -> f64 {
        match &self.gradients[gap] {
            None => n,
            Some(g) => g.index(n, self.surfaces[gap - 1].to_local(point, DVec3::Z).0),
        }
    }

    /// Follows a ray through a gap with a gradient to a surface, light running along `run` · z: point, direction, optical path (mm). `None`
    /// where it does not get there. Source: [`crate::gradient`].
    pub(crate) fn cross_gradient(
        &self,
        gap: usize,
        n: f64,
        surface: usize,
        ray: TracedRay,
        run: f64,
    ) -> Option<(TracedRay, f64)> {
        let gradient = self.gradients[gap].as_ref()?;
        let (home, target) = (&self.surfaces[gap - 1], &self.surfaces[surface]);
        let (position, direction) = home.to_local(ray.position, ray.direction);
        let distance = |r: &GradedRay| {
            let (o, d) = home.to_lens(r.position, r.direction);
            let (o, d) = target.to_local(o, d);
            target.profile.intersect(o, d, run).map(|m| m.t)
        };
        // Rays that wind are longer than the gap, but not without end.
        let most = 10.0 * (self.surfaces[gap].z - home.z).abs() + 50.0;
        let (there, path) = gradient.follow(n, GradedRay { position, direction }, most, distance)?;
        let (position, direction) = home.to_lens(there.position, there.direction);
        Some((TracedRay { position, direction }, path))
    }

    /// Sense of the light at the film: +1 along +z, −1 where an odd number of mirrors sends it back towards the object.
    pub fn film_run(&self) -> f64 {
        self.runs.last().copied().unwrap_or(1.0)
    }

    /// A ray of the object's space (whose axis is the base ray) in the coordinates of the surfaces, mm; the same where the lens has an axis.
    #[inline]
    pub fn ray_from_object(&self, ray: TracedRay) -> TracedRay {
        self.object_axis.as_ref().map_or(ray, |axis| moved(&axis.0, ray))
    }

    /// A ray in the coordinates of the surfaces as one of the object's space: undoes [`System::ray_from_object`].
    #[inline]
    pub fn ray_to_object(&self, ray: TracedRay) -> TracedRay {
        self.object_axis.as_ref().map_or(ray, |axis| moved(&axis.1, ray))
    }

    /// Whether every surface stands on the axis of the object, unturned.
    pub(crate) fn is_centered(&self) -> bool {
        self.object_axis.is_none() && self.surfaces.iter().all(|s| s.frame.is_none())
    }

    /// Light along the axis of the object, behind the last surface.
    pub(crate) fn base_ray(&self, n: &[f64]) -> Result<TracedRay, Blocked> {
        self.trace(TracedRay { position: DVec3::ZERO, direction: DVec3::Z }, n, TraceDirection::ToFilm, Apertures::Ignore)
    }

    /// Slope of the base ray at the film, towards the lens: 0 but for lenses with an axis of the object of their own.
    pub fn base_slope(&self, n: &[f64]) -> DVec2 {
        match self.object_axis.as_ref().map(|_| self.base_ray(n)) {
            Some(Ok(base)) => -base.direction.truncate() / base.direction.z.abs(),
            Some(Err(_)) | None => DVec2::ZERO,
        }
    }

    /// Unit direction of a ray from the film with a slope: change of x and y over the way along the axis towards the lens.
    #[inline]
    pub fn film_direction(&self, slope: DVec2) -> DVec3 {
        slope.extend(-self.film_run()).normalize()
    }

    /// Last vertex, mm.
    pub fn last_z(&self) -> f64 {
        self.surfaces.last().map_or(0.0, |s| s.z)
    }
}

fn moved(frame: &DAffine3, ray: TracedRay) -> TracedRay {
    TracedRay { position: frame.transform_point3(ray.position), direction: frame.transform_vector3(ray.direction) }
}

/// Moves the vertex to a place and turns about it: about x, then y, then z (Zemax and CODE V order for "tilt").
fn place(x: f64, y: f64, z: f64, tilt_deg: [f64; 3]) -> DAffine3 {
    let [a, b, c] = tilt_deg.map(f64::to_radians);
    DAffine3 { matrix3: DMat3::from_euler(EulerRot::XYZ, a, b, c), translation: DVec3::new(x, y, z) }
}
