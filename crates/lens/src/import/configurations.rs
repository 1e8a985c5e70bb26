//! Several configurations in one file: Zemax multi-configurations, CODE V zoom positions, OSLO configurations.
//!
//! What a prescription knows of them are gaps: over zoom positions, and between infinity and a near focus. So gaps that differ make a zoom lens
//! (positions in the order of their focal lengths), or, where nothing but two object distances and gaps differ, a lens with a near focus. What
//! else differs is not followed: the lens stands there as in the current configuration, with a note that names it.

use crate::glass::D_NM;
use crate::paraxial::FirstOrder;
use crate::prescription::{ApertureKind, Gap, Prescription};
use crate::system::{State, System};
use std::collections::BTreeMap;

/// Most configurations.
pub(super) const MOST: usize = 64;

/// What a file says of its configurations; lengths in mm.
#[derive(Debug, Default)]
pub(super) struct Configurations {
    /// How many.
    pub count: usize,
    /// Gap behind each surface that has one of its own in some, by the index of the surface; `None` where nothing is said.
    pub gaps: BTreeMap<usize, Vec<Option<f64>>>,
    /// Distance of the object; infinite beyond 1e9.
    pub object: Vec<Option<f64>>,
    /// Commands of what else differs.
    others: Vec<String>,
    /// First value of each of them, by what it is about.
    seen: BTreeMap<(String, String), String>,
}

impl Configurations {
    /// Notes the gap behind a surface in a configuration, both from 0.
    pub fn gap(&mut self, surface: usize, configuration: usize, mm: f64) {
        let row = self.gaps.entry(surface).or_default();
        row.resize(row.len().max(configuration + 1), None);
        row[configuration] = Some(mm);
    }

    /// Notes an object distance.
    pub fn object(&mut self, configuration: usize, mm: f64) {
        self.object.resize(self.object.len().max(configuration + 1), None);
        self.object[configuration] = Some(mm);
    }

    /// Notes a value of a command that is not followed, and what it is about.
    pub fn other(&mut self, command: &str, about: &str, value: &str) {
        let first = self.seen.entry((command.to_owned(), about.to_owned())).or_insert_with(|| value.to_owned());
        let same = first == value;
        if !same && self.others.len() < 40 && !self.others.iter().any(|o| o == command) {
            self.others.push(command.to_owned());
        }
    }

    /// Takes all lengths times a factor.
    pub fn scale(&mut self, factor: f64) {
        self.gaps.values_mut().chain([&mut self.object]).flatten().flatten().for_each(|v| *v *= factor);
    }

    /// Gives a lens, whose surfaces are still those of the file, its zoom positions or its near focus.
    pub fn apply(self, p: &mut Prescription) {
        if self.count < 2 {
            return;
        }
        let count = self.count;
        let own = |surface: usize| p.surfaces[surface].gap.at(0.0, 0.0);
        let filled = |row: &[Option<f64>], own: f64| -> Vec<f64> {
            (0..count).map(|i| row.get(i).copied().flatten().unwrap_or(own)).collect()
        };
        let differs = |row: &[f64]| row.iter().any(|v| (v - row[0]).abs() > 1e-12 * (1.0 + row[0].abs()));
        let gaps: BTreeMap<usize, Vec<f64>> = self
            .gaps
            .iter()
            .filter(|g| *g.0 < p.surfaces.len())
            .map(|(i, row)| (*i, filled(row, own(*i))))
            .filter(|g| differs(&g.1))
            .collect();
        let here = p.usage.object_distance.unwrap_or(f64::INFINITY);
        let objects: Vec<f64> = filled(&self.object, here).into_iter().map(|d| if d < 1e9 { d } else { f64::INFINITY }).collect();
        let objects_differ = objects.iter().any(|d| *d != objects[0]);
        if !self.others.is_empty() {
            let named = self.others.join(", ");
            p.notes.push(format!("between the file's {count} configurations {named} differ, which is not followed: they stand as in the current one"));
        }
        if gaps.is_empty() && !objects_differ {
            p.notes
                .push(format!("the file has {count} configurations with the same gaps: the one its surfaces stand in is read"));
            return;
        }
        let column = |i: usize| {
            let mut one = p.clone();
            gaps.iter().for_each(|(surface, row)| one.surfaces[*surface].gap = Gap::fixed(row[i]));
            one
        };
        let efl = |i: usize| {
            let system = System::at(&column(i), State::default());
            FirstOrder::of(&system, &system.indices(D_NM)).efl.abs()
        };
        let lengths: Vec<f64> = (0..count).map(efl).collect();
        if objects_differ && count == 2 {
            // Far first.
            let order = if objects[0] >= objects[1] { [0, 1] } else { [1, 0] };
            let near = order[1];
            let track: f64 = (0..p.surfaces.len()).map(|s| gaps.get(&s).map_or(own(s), |row| row[near])).sum();
            let close = objects[near] + track;
            if close > 0.0 {
                for (surface, row) in &gaps {
                    p.surfaces[*surface].gap = Gap { values: order.iter().map(|i| vec![row[*i]]).collect() };
                }
                p.close_focus = Some(close);
                p.usage.object_distance = Some(objects[order[0]]).filter(|d| d.is_finite());
                p.notes.push(format!(
                    "the file's two configurations are its far and its near focus, {close:.1} mm from object to film"
                ));
                return;
            }
        }
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| lengths[*a].total_cmp(&lengths[*b]));
        let apart = order.windows(2).all(|w| lengths[w[1]] > lengths[w[0]] * (1.0 + 1e-9));
        if !apart || objects_differ || !lengths.iter().all(|f| f.is_finite() && *f > 0.0) {
            p.notes.push(format!(
                "the file's {count} configurations are no zoom positions of different focal lengths: the one its surfaces stand in is read"
            ));
            return;
        }
        for (surface, row) in &gaps {
            p.surfaces[*surface].gap = Gap { values: vec![order.iter().map(|i| row[*i]).collect()] };
        }
        p.zoom = order.iter().map(|i| lengths[*i]).collect();
        p.notes.push(format!("the file's {count} configurations are zoom positions, in the order of their focal lengths"));
        if matches!(p.usage.aperture, Some(ApertureKind::EntrancePupil(_) | ApertureKind::ObjectNa(_))) {
            p.notes.push(
                "the f-number at the first of them is that of all: the file's entrance pupil is not held while the lens zooms"
                    .into(),
            );
        }
    }
}
