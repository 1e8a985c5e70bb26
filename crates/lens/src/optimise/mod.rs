//! Optimisation: a better lens from a given one, by what a merit file wants.
//!
//! A [`MeritSheet`] names variables and operands; [`Optimisation`] is a lens with it. Spots and wavefronts enter ray by ray, so that
//! the least squares see how each ray moves (Kidger, "Intermediate Optical Design", ch. 2; Smith, "Modern Lens Design", ch. 2), on the
//! few rays of a Gaussian quadrature (`bundle.rs`). Beams keep their size in the entrance pupil and are aimed at the middle of
//! the stop of each lens that is tried; rims do not clip meanwhile, and are made large enough at the end. Derivatives are exact, by a reverse
//! pass through the f64 packet trace (`derivatives.rs`); of lenses with ideal, diffractive, Fresnel or graded parts, of gaps within groups that are turned as a whole, of toroids plane
//! along y, and of starts without power they are central differences. Glasses are chosen from catalogues by exchanges, one at a time (`glass.rs`). Light goes from the object to the film.

mod exact;
pub mod fit;
mod glass;
mod levenberg;
mod operand;
mod problem;
mod sheet;

pub use levenberg::Stop;
pub(crate) use levenberg::{Residuals, levenberg_marquardt};
pub use problem::{Freedom, Operand, OperandKind, Variable, Wanted};
pub use sheet::MeritSheet;

use crate::LensError;
use crate::analysis::Bench;
use crate::bundle::{AimedBundle, Bundle, RayAiming, Sampling, Tracer};
use crate::compound::{Configured, FilmPlace, configure};
use crate::glass::D_NM;
use crate::paraxial::{Cardinal, FirstOrder};
use crate::prescription::{ApertureKind, Prescription, PrescriptionError, asphere_of};
use crate::surface::{Asphere, Profile};
use crate::system::{State, System};
use crate::tolerance::{bent_to, colors_of, fields_of, lit_height, shifted};
use levenberg::{differential_evolution, merit};
use operand::{Arrival, Seen, Terms};

/// Rays of a beam: enough for the ninth order of aberrations.
const SAMPLING: Sampling = Sampling { arms: 12, rings: 4 };
/// Fields by default, as fractions of the largest: a lens is the same on both sides of its axis.
const FIELDS: [f64; 3] = [0.0, 0.7, 1.0];
/// How much larger than the beam a rim is made, where it must grow.
const RIM_MARGIN: f64 = 1.001;
/// Steps of central differences move a surface at its rim by so much, mm: rounding (1e-13 mm) and the third derivative both stay below
/// 1e-6 of the derivative.
const SAG_STEP: f64 = 1e-5;

/// A lens that can be optimised.
#[derive(Clone)]
pub struct Optimisation {
    start: Prescription,
    state: State,
    object_distance: Option<f64>,
    wavelengths: Vec<f64>,
    weights: Vec<f64>,
    reference: usize,
    fields_deg: Vec<f64>,
    fields: Vec<Bundle>,
    axis: Bundle,
    entrance_pupil: Option<f64>,
    variables: Vec<Variable>,
    bounds: Vec<[f64; 2]>,
    steps: Vec<f64>,
    operands: Vec<Operand>,
    choices: Vec<glass::GlassChoice>,
    /// Largest height of the axial beam at the stop of the start, mm.
    stop_height: f64,
    /// Focal length that distortion is measured against, mm.
    ideal_efl: Option<f64>,
    file: String,
    seed: u64,
}

/// An operand before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct OperandReport {
    /// What it is called.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// What was wanted.
    pub wanted: Wanted,
    /// Its value in the start and in the result.
    pub values: [f64; 2],
    /// What it adds to the merit, in the start and in the result.
    pub merits: [f64; 2],
}

/// What an optimisation came to.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimisationReport {
    /// The better lens.
    pub lens: Prescription,
    /// Merit of the start (infinite where rays are lost) and of the result.
    pub merits: [f64; 2],
    /// Operands in the order of the file.
    pub operands: Vec<OperandReport>,
    /// Variables: name, value before, value after, and whether it ends on a bound.
    pub variables: Vec<(String, f64, f64, bool)>,
    /// Glasses that could be chosen: surface before it (0 the first), glass before and after, as prescriptions write them.
    pub glasses: Vec<(usize, String, String)>,
    /// Exchanges of a glass that were tried.
    pub exchanges: usize,
    /// Steps that were taken.
    pub iterations: usize,
    /// Why it ended.
    pub stop: Stop,
}

/// Rays of a field where they land, of each wavelength.
type Colors = Vec<Vec<Arrival<f64>>>;

/// Whether distortion exists at a field.
fn has_distortion(field_deg: f64) -> bool {
    field_deg != 0.0 && field_deg.abs() < 89.0
}

/// Value of a variable in a lens.
fn value_of(p: &Prescription, freedom: Freedom) -> f64 {
    match freedom {
        Freedom::Curvature { surface } => p.surfaces[surface].profile.base_curvature(),
        Freedom::Gap { surface } => p.surfaces[surface].gap.at(0.0, 0.0),
        Freedom::Conic { surface } => asphere_of(&p.surfaces[surface].profile).map_or(0.0, |a| a.k),
        Freedom::Asphere { surface, power } => {
            asphere_of(&p.surfaces[surface].profile).and_then(|a| a.a.get(power).copied()).unwrap_or(0.0)
        }
        Freedom::Index { surface } => p.surfaces[surface].glass.index(D_NM),
    }
}

/// Sets a variable. The result need not be a lens that can be made: whoever sets it looks.
fn set_value(p: &mut Prescription, freedom: Freedom, value: f64) {
    let before = value_of(p, freedom);
    if value == before {
        return;
    }
    let shape = |p: &mut Prescription, surface: usize, change: &dyn Fn(&mut Asphere)| {
        if let Some(mut a) = asphere_of(&p.surfaces[surface].profile) {
            change(&mut a);
            p.surfaces[surface].profile = crate::prescription::profile(a.c, a.k, a.a, None);
        }
    };
    match freedom {
        Freedom::Curvature { surface } => match asphere_of(&p.surfaces[surface].profile) {
            Some(_) => shape(p, surface, &|a| a.c = value),
            None => p.surfaces[surface].profile = bent_to(&p.surfaces[surface].profile, value),
        },
        // All positions of focus and zoom move alike.
        Freedom::Gap { surface } => {
            p.surfaces[surface].gap.values.iter_mut().flatten().for_each(|g| *g += value - before);
        }
        Freedom::Conic { surface } => shape(p, surface, &|a| a.k = value),
        Freedom::Asphere { surface, power } => shape(p, surface, &|a| {
            a.a.resize(a.a.len().max(power + 1), 0.0);
            a.a[power] = value;
        }),
        Freedom::Index { surface } => {
            let glass = &p.surfaces[surface].glass;
            // Bounds hold it within what a glass can have.
            if let Ok(glass) = shifted(glass, value - before, 0.0) {
                p.surfaces[surface].glass = glass;
            }
        }
    }
}

/// The step of a variable that moves its surface at the rim by `sag` mm.
fn step_of(lens: &Prescription, freedom: Freedom, sag: f64) -> f64 {
    let reach = |s: usize| lens.surfaces[s].semi_diameter.unwrap_or(1.0).max(1e-3);
    match freedom {
        Freedom::Curvature { surface } => 2.0 * sag / reach(surface).powi(2),
        Freedom::Gap { .. } | Freedom::Index { .. } => sag,
        Freedom::Conic { surface } => {
            let c = value_of(lens, Freedom::Curvature { surface });
            (8.0 * sag / (c.abs().powi(3) * reach(surface).powi(4)).max(1e-12)).min(1e-3)
        }
        Freedom::Asphere { surface, power } => sag / reach(surface).powi(power as i32),
    }
}

impl Optimisation {
    /// Checks a merit file against a lens and finds its beams. Fails on surfaces that are not there, bounds that the lens is not
    /// within, and fields without light.
    pub fn new(lens: &Prescription, sheet: &MeritSheet) -> Result<Optimisation, LensError> {
        let wrong = |what: String| LensError::from(PrescriptionError::at(&sheet.file, 0, what));
        let variables = sheet.variables(lens)?;
        // Round beams need no lens that makes an image: plane plates are a start, too.
        let (system, state, height) = match sheet.entrance_pupil {
            None => {
                let aperture = sheet.aperture.or_else(|| lens.used_f_number());
                let set = configure(lens, sheet.focal_length, aperture, None, FilmPlace::AsPublished)?;
                let height = lit_height(lens, &set);
                let Configured { system, state, .. } = set;
                (system, state, height)
            }
            Some(_) => {
                let state = match sheet.focal_length {
                    Some(_) => configure(lens, sheet.focal_length, None, None, FilmPlace::AsPublished)?.state,
                    None => State::default(),
                };
                (System::at(lens, state), state, lens.image_circle.map(|circle| 0.5 * circle))
            }
        };
        let (colors, reference) = colors_of(lens, sheet.wavelengths_nm.as_ref(), sheet.weights.as_ref());
        let wavelengths: Vec<f64> = colors.iter().map(|c| c.0).collect();
        let total: f64 = colors.iter().map(|c| c.1).sum();
        let fields_deg = fields_of(lens, &system, height, sheet.fields_deg.as_ref(), &FIELDS);
        let operands = sheet.operands(lens, &fields_deg)?;
        let choices = sheet.glasses(lens, &wavelengths)?;
        let object_distance = lens.usage.object_distance.filter(|d| d.is_finite() && *d < 1e9);
        let bench = Bench { system: &system, object_distance };
        let nm = wavelengths[reference];
        let bundle = |field: f64, vignetting: f64| match sheet.entrance_pupil {
            None => Bundle::lit(&bench, field, nm, SAMPLING),
            Some(d) => Bundle::round(&bench, field, nm, 0.5 * d, vignetting, SAMPLING),
        };
        let dark = |field: f64| wrong(format!("field {field}: no light comes through the start there; expected a smaller angle"));
        let fields = fields_deg
            .iter()
            .enumerate()
            .map(|(i, f)| bundle(*f, sheet.vignetting.as_ref().map_or(0.0, |v| v[i])).ok_or_else(|| dark(*f)))
            .collect::<Result<Vec<_>, _>>()?;
        let axis = bundle(0.0, 0.0).ok_or_else(|| dark(0.0))?;
        let tracer = Tracer::new(&system, &wavelengths);
        let stop_height = axis
            .aim(&tracer, reference, RayAiming::Entrance)
            .and_then(|aimed| axis.heights(&tracer, aimed, reference))
            .map_or(0.0, |h| h[system.stop]);
        let ideal_efl = operands.iter().find_map(|o| match (o.kind, o.wanted) {
            (OperandKind::Efl, Wanted::Target(t)) => Some(t),
            _ => None,
        });
        Ok(Optimisation {
            start: lens.clone(),
            state,
            object_distance,
            weights: colors.iter().map(|c| c.1 / total).collect(),
            wavelengths,
            reference,
            fields_deg,
            fields,
            axis,
            entrance_pupil: sheet.entrance_pupil,
            bounds: variables.iter().map(|v| v.bounds).collect(),
            steps: variables.iter().map(|v| step_of(lens, v.freedom, SAG_STEP)).collect(),
            variables,
            operands,
            choices,
            stop_height,
            ideal_efl,
            file: sheet.file.clone(),
            seed: sheet.seed,
        })
    }

    /// The lens with given values of its variables.
    fn lens_at(&self, x: &[f64]) -> Prescription {
        let mut lens = self.start.clone();
        for (v, value) in self.variables.iter().zip(x) {
            set_value(&mut lens, v.freedom, *value);
        }
        lens
    }

    /// Values of the variables in the start.
    fn start_values(&self) -> Vec<f64> {
        self.variables.iter().map(|v| value_of(&self.start, v.freedom)).collect()
    }

    /// Where all rays of all fields and wavelengths land; `None` where one does not arrive.
    fn land(&self, tracer: &Tracer) -> Option<Vec<(AimedBundle, Colors)>> {
        let of = |field: &Bundle| {
            let aimed = field.aim(tracer, self.reference, RayAiming::Entrance)?;
            let land = |color: usize| Some(field.trace(tracer, aimed, color)?.iter().map(Arrival::from).collect());
            Some((aimed, (0..self.wavelengths.len()).map(land).collect::<Option<_>>()?))
        };
        self.fields.iter().map(of).collect()
    }

    /// What operands know of the merit.
    fn terms(&self) -> Terms<'_> {
        Terms {
            fields_deg: &self.fields_deg,
            wavelengths: &self.wavelengths,
            weights: &self.weights,
            reference: self.reference,
            object_distance: self.object_distance,
            ideal_efl: self.ideal_efl,
        }
    }

    /// Value and residuals of each operand; `None` where a ray does not arrive.
    fn evaluate(&self, lens: &Prescription) -> Option<Vec<(f64, Vec<f64>)>> {
        let system = System::at(lens, self.state);
        let tracer = Tracer::new(&system, &self.wavelengths);
        let rays: Vec<_> = self.land(&tracer)?.into_iter().map(|(_, rays)| rays).collect();
        let image_indices: Vec<f64> = (0..self.wavelengths.len()).map(|color| tracer.image_index(color)).collect();
        let seen = Seen {
            rays: &rays,
            first: Cardinal::from(&FirstOrder::of(&system, tracer.indices(self.reference))),
            film_z: system.film_z,
            thickness: &|s| lens.surfaces[s].gap.at(self.state.zoom, self.state.focus),
            edge: &|s| self.edge(&system, s),
            image_indices: &image_indices,
        };
        let terms = self.terms();
        Some(self.operands.iter().map(|o| terms.of(o, &seen)).collect())
    }

    /// The sag (mm) that counts for the rim of a surface: at the smaller rim of two; where it does not reach that far, where it ends. And whether
    /// it reaches.
    fn sag_at_rim(&self, profile: &Profile, gap: usize) -> (f64, bool) {
        let h = self.rim(gap);
        match profile.sag(0.0, h) {
            Some(sag) => (sag, true),
            // Hemispheres end before their rim: the steepest sag stands in.
            None => (if profile.curvature() != 0.0 { 1.0 / profile.curvature() } else { 0.0 }, false),
        }
    }

    /// The smaller rim of the two surfaces of a gap, mm.
    fn rim(&self, gap: usize) -> f64 {
        let rim = |i: usize| self.start.surfaces[i].semi_diameter.unwrap_or(0.0);
        rim(gap).min(rim(gap + 1))
    }

    /// Gap after a surface at the smaller rim of its two, mm.
    fn edge(&self, system: &System, surface: usize) -> f64 {
        let (front, back) = (&system.surfaces[surface], &system.surfaces[surface + 1]);
        let [near, far] = [front, back].map(|s| self.sag_at_rim(&s.profile, surface).0);
        system.runs[surface + 1] * (back.z - front.z + far - near)
    }

    /// Merit of the start; infinite where rays are lost.
    pub fn start_merit(&self) -> f64 {
        merit(self, &self.start_values())
    }

    /// Derivatives of all residuals in the start, a column a variable; nothing where rays are lost.
    pub fn start_derivatives(&self) -> Vec<Vec<f64>> {
        let start = self.start_values();
        let exact = self.exact_derivatives(&start);
        exact.or_else(|| self.at(&start).map(|here| levenberg::differences(self, &start, &here))).unwrap_or_default()
    }

    /// Finds a better lens: `generations` of a global search first (0: none), then damped least squares of at most `iterations`
    /// steps. Fails where no lens was found that light goes through, and where the result could not be built.
    pub fn run(&self, generations: usize, iterations: usize) -> Result<OptimisationReport, LensError> {
        let wrong = |what: String| LensError::from(PrescriptionError::at(&self.file, 0, what));
        let start = self.start_values();
        let from = match generations {
            0 => start.clone(),
            _ => differential_evolution(self, &start, generations, self.seed),
        };
        let found = levenberg_marquardt(self, &from, iterations).ok_or_else(|| {
            let what = "rays of the start are lost or have no focus: expected smaller fields or aperture, or a global search";
            wrong(what.into())
        })?;
        let (best, found, exchanges) = glass::choose(self, found, iterations);
        let before_merit = merit(self, &start);
        let lens = best.finished(&found.x, [before_merit, found.merit]).map_err(|e| {
            let what = "expected an [[operand]] of kind \"edge\" or \"thickness\" that keeps surfaces apart";
            wrong(format!("the result cannot be built ({e}): {what}"))
        })?;
        let values = [self.evaluate(&self.start), best.evaluate(&best.lens_at(&found.x))];
        let part = |v: &Option<Vec<(f64, Vec<f64>)>>, i: usize| {
            v.as_ref().map_or((f64::NAN, f64::NAN), |v| (v[i].0, v[i].1.iter().map(|r| r * r).sum()))
        };
        let operands = self
            .operands
            .iter()
            .enumerate()
            .map(|(i, o)| {
                let [a, b] = [0, 1].map(|k| part(&values[k], i));
                let name = o.name(&self.fields_deg);
                OperandReport { name, unit: o.kind.unit(), wanted: o.wanted, values: [a.0, b.0], merits: [a.1, b.1] }
            })
            .collect();
        let variables = (0..self.variables.len())
            .map(|i| {
                let v = &self.variables[i];
                (v.name(), start[i], found.x[i], v.bounds.contains(&found.x[i]))
            })
            .collect();
        let merits = [before_merit, found.merit];
        let glass = |p: &Prescription, c: &glass::GlassChoice| p.surfaces[c.surface].glass.written();
        let glasses = self.choices.iter().map(|c| (c.surface, glass(&self.start, c), glass(&lens, c))).collect();
        Ok(OptimisationReport {
            lens,
            merits,
            operands,
            variables,
            glasses,
            exchanges,
            iterations: found.iterations,
            stop: found.stop,
        })
    }

    /// The lens at given values with rims that let its beams through, its stop as large as the axial beam, checked.
    fn finished(&self, x: &[f64], merits: [f64; 2]) -> Result<Prescription, LensError> {
        let mut lens = self.lens_at(x);
        let system = System::at(&lens, self.state);
        let tracer = Tracer::new(&system, &self.wavelengths);
        let mut needed = vec![0.0f64; lens.surfaces.len()];
        for bundle in self.fields.iter().chain([&self.axis]) {
            let heights =
                bundle.aim(&tracer, self.reference, RayAiming::Entrance).and_then(|a| bundle.heights(&tracer, a, self.reference));
            needed.iter_mut().zip(heights.unwrap_or_default()).for_each(|(n, h)| *n = n.max(h));
        }
        let stop = lens.stop();
        let axial = self
            .axis
            .aim(&tracer, self.reference, RayAiming::Entrance)
            .and_then(|a| self.axis.heights(&tracer, a, self.reference))
            .map(|h| h[stop]);
        for (i, s) in lens.surfaces.iter_mut().enumerate() {
            let stated = s.semi_diameter.unwrap_or(0.0);
            let reaches = s.profile.sag(0.0, stated).is_some();
            if i == stop
                && let Some(height) = axial.filter(|h| *h > 0.0)
            {
                // What the start's own iris leaves of its stop, the result leaves of its.
                let scaled = if self.stop_height > 0.0 { stated * height / self.stop_height } else { height };
                s.semi_diameter = Some(if self.entrance_pupil.is_some() { height } else { scaled });
            } else if needed[i] > stated || !reaches && needed[i] > 0.0 {
                s.semi_diameter = Some(needed[i] * RIM_MARGIN);
            }
        }
        let efl = FirstOrder::of(&system, tracer.indices(self.reference)).efl;
        if self.start.focal_length.is_some() || self.entrance_pupil.is_some() {
            lens.focal_length = Some(efl).filter(|f| f.abs() > 1e-3 && f.abs() < 1e6);
        }
        if let Some(d) = self.entrance_pupil {
            lens.usage.aperture = Some(ApertureKind::EntrancePupil(d));
            lens.f_number = Some(efl.abs() / d).filter(|n| *n < 1e5);
        }
        let count = self.variables.len();
        lens.name = format!("{}, optimised", self.start.name);
        lens.notes.push(format!(
            "optimised from \"{}\" by {}: {count} variables, {} operands, merit {:.6e} to {:.6e}",
            self.start.name,
            self.file,
            self.operands.len(),
            merits[0],
            merits[1]
        ));
        Ok(lens.checked(&self.file)?)
    }
}

impl Residuals for Optimisation {
    fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
        let all: Vec<f64> = self.evaluate(&self.lens_at(x))?.into_iter().flat_map(|(_, r)| r).collect();
        all.iter().all(|r| r.is_finite()).then_some(all)
    }

    fn bounds(&self) -> &[[f64; 2]] {
        &self.bounds
    }

    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn derivatives(&self, x: &[f64]) -> Option<Vec<Vec<f64>>> {
        self.exact_derivatives(x)
    }
}

#[cfg(test)]
mod tests;
