//! Exact derivatives of the residuals by all variables: what the trace, first order, gaps and rims give, put together.

use super::operand::{Arrival, Seen, spot_changes};
use super::{Freedom, Operand, OperandKind, Optimisation, Variable, Wanted};
use crate::bundle::{ByParameters, FilmPointChange, Needed, Tracer};
use crate::derivatives::{Differentiated, Parameter, sag_by};
use crate::dual::{Dual, Number};
use crate::glass::Glass;
use crate::paraxial::{Cardinal, Element};
use crate::prescription::{Prescription, asphere_of};
use crate::surface::Profile;
use crate::system::System;
use crate::tolerance::shifted;

/// Index by which a glass is shifted to see how its other wavelengths follow.
const INDEX_STEP: f64 = 1e-4;

impl Optimisation {
    /// The parameter of the trace that each variable is; `None` where derivatives have no formula.
    fn parameters(&self) -> Option<Vec<Parameter>> {
        let of = |v: &Variable| {
            Some(match v.freedom {
                Freedom::Curvature { surface } => Parameter::Curvature(surface),
                // A group that is turned as a whole carries its gaps along: no shift along the axis.
                Freedom::Gap { surface } => self.start.misalignments.is_empty().then_some(Parameter::Gap(surface))?,
                Freedom::Conic { surface } => Parameter::Conic(surface),
                Freedom::Asphere { surface, power } => Parameter::Coefficient(surface, power),
                Freedom::Index { surface } => Parameter::Index(surface),
            })
        };
        self.variables.iter().map(of).collect()
    }

    /// Change of the index at each wavelength by each variable; 1 of what is no index.
    fn index_changes(&self, lens: &Prescription) -> Option<Vec<Vec<f64>>> {
        // All wavelengths are linear in the shift: any step does.
        let both = |v: &Variable| match v.freedom {
            Freedom::Index { surface } => {
                let own = &lens.surfaces[surface].glass;
                Some(Some([shifted(own, INDEX_STEP, 0.0).ok()?, shifted(own, -INDEX_STEP, 0.0).ok()?]))
            }
            _ => Some(None),
        };
        let glasses: Vec<Option<[Glass; 2]>> = self.variables.iter().map(both).collect::<Option<_>>()?;
        let change = |nm: f64| {
            let of = |g: &Option<[Glass; 2]>| {
                g.as_ref().map_or(1.0, |[more, less]| (more.index(nm) - less.index(nm)) / (2.0 * INDEX_STEP))
            };
            glasses.iter().map(of).collect()
        };
        Some(self.wavelengths.iter().map(|nm| change(*nm)).collect())
    }

    /// First order with its derivative by one variable.
    fn cardinal_by(&self, system: &System, n: &[f64], freedom: Freedom, index_change: f64) -> Cardinal<Dual<1>> {
        let with = |value: f64, by: f64| Dual { value, derivatives: [by] };
        let elements: Vec<Element<Dual<1>>> = (0..system.surfaces.len())
            .map(|i| {
                let distance = if i == 0 { 0.0 } else { system.surfaces[i].z - system.surfaces[i - 1].z };
                let moves = matches!(freedom, Freedom::Gap { surface } if surface + 1 == i);
                let curvature = system.surfaces[i].profile.curvature();
                let bends = match freedom {
                    Freedom::Curvature { surface } if surface == i => 1.0,
                    Freedom::Asphere { surface, power: 2 } if surface == i => 2.0,
                    _ => 0.0,
                };
                let index = |gap: usize| {
                    let changes = matches!(freedom, Freedom::Index { surface } if surface + 1 == gap);
                    with(n[gap], f64::from(u8::from(changes)) * index_change).scaled(system.runs[gap])
                };
                Element {
                    distance: with(distance, f64::from(u8::from(moves))),
                    curvature: with(curvature, bends),
                    indices: [index(i), index(i + 1)],
                }
            })
            .collect();
        Cardinal::of(&elements, system.stop, system.runs[system.surfaces.len()])
    }

    /// Derivatives of the residuals by all variables, a column each: by a reverse pass through the trace (`derivatives.rs`). `None` where they have no
    /// formula, or a ray does not arrive.
    pub(super) fn exact_derivatives(&self, x: &[f64]) -> Option<Vec<Vec<f64>>> {
        let parameters = self.parameters()?;
        let lens = self.lens_at(x);
        // A toroid that is or was plane along y has no proportion in which its curvatures grow.
        let bends_both = |v: &Variable| match v.freedom {
            Freedom::Curvature { surface } => [&self.start, &lens].iter().all(|p| {
                let profile = &p.surfaces[surface].profile;
                asphere_of(profile).is_some() || profile.base_curvature() != 0.0
            }),
            _ => true,
        };
        if !self.variables.iter().all(bends_both) {
            return None;
        }
        let system = System::at(&lens, self.state);
        let tracer = Tracer::new(&system, &self.wavelengths);
        let differentiated = Differentiated::new(&tracer.system, &parameters)?;
        let by = ByParameters { lens: &differentiated, index_changes: self.index_changes(&lens)? };
        let landed = self.land(&tracer)?;
        let image_indices: Vec<f64> = (0..self.wavelengths.len()).map(|color| tracer.image_index(color)).collect();
        let is_spot = |o: &Operand| o.kind == OperandKind::Spot && o.wanted == Wanted::Target(0.0);
        let mut rays = vec![];
        let mut changes: Vec<Vec<Vec<Vec<FilmPointChange>>>> = vec![];
        // Fields whose rays are looked at by more than spots.
        let mut curved = vec![false; self.fields.len()];
        for (i, (field, (aimed, colors))) in self.fields.iter().zip(landed).enumerate() {
            let of_field = |o: &&Operand| o.field.unwrap_or(0) == i;
            let any = |kinds: &[OperandKind]| self.operands.iter().filter(of_field).any(|o| kinds.contains(&o.kind));
            let needed = Needed {
                cosines: any(&[OperandKind::Wavefront, OperandKind::Mtf, OperandKind::ChiefAngle]),
                path: any(&[OperandKind::Wavefront]),
            };
            curved[i] = needed.cosines
                || any(&[OperandKind::Distortion])
                || self.operands.iter().filter(of_field).any(|o| o.kind == OperandKind::Spot && !is_spot(o));
            let moved = field.aim_changes(&tracer, &by, aimed, self.reference)?;
            let change = |color: usize| field.trace_changes(&tracer, &by, (aimed, &moved), color, needed);
            changes.push((0..colors.len()).map(change).collect::<Option<_>>()?);
            rays.push(colors);
        }
        let terms = self.terms();
        let needs_first =
            self.operands.iter().any(|o| matches!(o.kind, OperandKind::Efl | OperandKind::Bfl | OperandKind::Distortion));
        let nothing = Dual::constant(0.0);
        let nowhere = Cardinal { efl: nothing, bfl: nothing, ffl: nothing, entrance_pupil_z: nothing };
        let columns = self.variables.iter().enumerate().map(|(number, v)| {
            let [low, high] = self.bounds[number];
            let here: Vec<Vec<Vec<Arrival<Dual<1>>>>> = (0..rays.len())
                .map(|f| match curved[f] {
                    false => vec![],
                    true => (0..rays[f].len())
                        .map(|c| rays[f][c].iter().zip(&changes[f][c][number]).map(|(r, by)| r.changing(by)).collect())
                        .collect(),
                })
                .collect();
            let with = |value: f64, by: f64| Dual { value, derivatives: [by] };
            let moves = |gap: usize| f64::from(u8::from(matches!(v.freedom, Freedom::Gap { surface } if surface == gap)));
            let moves_film = f64::from(u8::from(matches!(v.freedom, Freedom::Gap { .. })));
            let edge = |gap: usize| {
                let side = |i: usize| self.sag_by(&system.surfaces[i].profile, parameters[number], i, gap);
                let by = moves(gap) + side(gap + 1) - side(gap);
                with(self.edge(&system, gap), system.runs[gap + 1] * by)
            };
            let last = lens.surfaces.len() - 1;
            let behind = matches!(v.freedom, Freedom::Index { surface } if surface == last);
            let image_indices: Vec<Dual<1>> = image_indices
                .iter()
                .zip(&by.index_changes)
                .map(|(n, changes)| with(*n, f64::from(u8::from(behind)) * changes[number]))
                .collect();
            let seen = Seen {
                rays: &here,
                first: match needs_first {
                    true => self.cardinal_by(
                        &system,
                        tracer.indices(self.reference),
                        v.freedom,
                        by.index_changes[self.reference][number],
                    ),
                    false => nowhere,
                },
                film_z: with(system.film_z, moves_film),
                thickness: &|s| with(lens.surfaces[s].gap.at(self.state.zoom, self.state.focus), moves(s)),
                edge: &edge,
                image_indices: &image_indices,
            };
            let mut column = vec![];
            for o in &self.operands {
                if is_spot(o) {
                    let field = o.field.unwrap_or(0);
                    let by: Vec<&[FilmPointChange]> = changes[field].iter().map(|color| color[number].as_slice()).collect();
                    column.extend(spot_changes(o, &self.weights, &rays[field], &by));
                } else {
                    column.extend(terms.of(o, &seen).1.iter().map(|r| r.derivatives[0]));
                }
            }
            // What is held by its bounds does not change.
            if low == high {
                column.fill(0.0);
            }
            column
        });
        let columns: Vec<Vec<f64>> = columns.collect();
        columns.iter().flatten().all(|v| v.is_finite()).then_some(columns)
    }

    /// Change of the sag that counts for a rim by a parameter, mm a unit.
    fn sag_by(&self, profile: &Profile, parameter: Parameter, surface: usize, gap: usize) -> f64 {
        let of_this =
            matches!(parameter, Parameter::Curvature(s) | Parameter::Conic(s) | Parameter::Coefficient(s, _) if s == surface);
        match self.sag_at_rim(profile, gap) {
            _ if !of_this => 0.0,
            (_, true) => sag_by(profile, parameter, 0.0, self.rim(gap)),
            (sag, false) => match parameter {
                Parameter::Curvature(_) => -sag * sag,
                Parameter::Coefficient(_, 2) => -2.0 * sag * sag,
                _ => 0.0,
            },
        }
    }
}
