//! Where in the scene which density of directions holds: a binary tree over positions and normals.
//!
//! A region is divided at the mean of its records across the dimension in which they vary most, so that regions follow the surfaces that
//! paths meet, however large the scene around them is. Light depends on the position alone; but surfaces of different orientation at the same
//! place can use different halves of it, therefore normals are dimensions, too: unlike orientations are parted where a region is about a quarter
//! of the scene wide. Sources: T. Müller et al. 2017 (halves of the sides in turn), L. Ruppert et al. 2020, "Robust Fitting of
//! Parallax-Aware Mixtures for Path Guiding" (splits at the mean across the largest variance).

use glam::Vec3;

/// Position (m) and unit normal.
pub(super) type Place = [f32; 6];

/// A place of a surface, its normal on the side of the path.
#[inline]
pub(super) fn place(position: Vec3, normal: Vec3) -> Place {
    [position.x, position.y, position.z, normal.x, normal.y, normal.z]
}

/// Length that a component of a normal counts for in comparison with positions, in widths of the scene.
const NORMAL_WIDTH: f64 = 0.125;
/// Least variance of a component of a normal for which it is worth parting: 0.2².
const LEAST_NORMAL_VARIANCE: f64 = 0.04;
/// In links: a region and no split.
const REGION: u32 = 1 << 31;
const NOBODY: u32 = u32::MAX;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Split {
    dimension: u32,
    at: f32,
    /// Of what is below, and of the rest: a split or a region.
    links: [u32; 2],
}

/// The tree; its regions are numbered from 0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SpatialTree {
    splits: Vec<Split>,
    /// Of each region, where its link is: twice the split and the side.
    owners: Vec<u32>,
}

impl SpatialTree {
    /// One region.
    pub fn new() -> Self {
        SpatialTree { splits: Vec::new(), owners: vec![NOBODY] }
    }

    /// The region of a place.
    #[inline]
    pub fn find(&self, place: &Place) -> usize {
        let mut link = if self.splits.is_empty() { REGION } else { 0 };
        while link & REGION == 0 {
            let split = &self.splits[link as usize];
            link = split.links[usize::from(place[split.dimension as usize] >= split.at)];
        }
        (link & !REGION) as usize
    }

    /// Divides a region: it keeps what is below, the rest is a new region, the last.
    pub fn split(&mut self, region: usize, dimension: usize, at: f32) {
        let (split, new) = (self.splits.len() as u32, self.owners.len() as u32);
        let owner = self.owners[region];
        if owner != NOBODY {
            self.splits[owner as usize / 2].links[owner as usize % 2] = split;
        }
        self.splits.push(Split { dimension: dimension as u32, at, links: [REGION | region as u32, REGION | new] });
        self.owners[region] = 2 * split;
        self.owners.push(2 * split + 1);
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> usize {
        self.splits.len() * size_of::<Split>() + self.owners.len() * size_of::<u32>()
    }
}

/// How the places of records are spread.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spread {
    pub count: f64,
    /// Positions are summed from the first one on, so that squares keep their digits far from the origin.
    from: Place,
    sums: [f64; 6],
    squares: [f64; 6],
}

impl Spread {
    pub fn new() -> Self {
        Spread { count: 0.0, from: [0.0; 6], sums: [0.0; 6], squares: [0.0; 6] }
    }

    pub fn add(&mut self, place: &Place) {
        if self.count == 0.0 {
            self.from = *place;
        }
        self.count += 1.0;
        for k in 0..6 {
            let x = f64::from(place[k]) - f64::from(self.from[k]);
            self.sums[k] += x;
            self.squares[k] += x * x;
        }
    }

    fn variance(&self, k: usize) -> f64 {
        let mean = self.sums[k] / self.count;
        (self.squares[k] / self.count - mean * mean).max(0.0)
    }

    /// Standard deviation of the positions, m.
    pub fn deviation(&self) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|k| self.variance(k).sqrt() as f32))
    }

    /// The dimension across which to divide, and where; `width_m` of the scene. `None` where all records are at one place.
    pub fn split(&self, width_m: f64) -> Option<(usize, f32)> {
        let weighed = |k: usize| match (k, self.variance(k)) {
            (0..3, variance) => variance,
            (_, variance) if variance < LEAST_NORMAL_VARIANCE => 0.0,
            (_, variance) => variance * (NORMAL_WIDTH * width_m).powi(2),
        };
        let (dimension, largest) = (0..6).map(|k| (k, weighed(k))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let at = f64::from(self.from[dimension]) + self.sums[dimension] / self.count;
        // Not finer than single precision can tell apart.
        let resolved = largest.sqrt() > 1e-5 * at.abs();
        (largest > 0.0 && resolved && at.is_finite()).then_some((dimension, at as f32))
    }
}

/// Width of a scene by where the records of its paths are, m: four times the largest median distance from the median, which is the width if
/// they are spread evenly, and does not mind a horizon. 1 where there is nothing to measure.
pub(super) fn width_of<'a>(places: impl Iterator<Item = &'a Place> + Clone) -> f64 {
    let median = |mut values: Vec<f32>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
    };
    let distance = |k: usize| {
        let middle = median(places.clone().map(|p| p[k]).collect());
        median(places.clone().map(|p| (p[k] - middle).abs()).collect())
    };
    let width = 4.0 * f64::from((0..3).map(distance).fold(0.0, f32::max));
    if width > 0.0 && width.is_finite() { width } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    #[test]
    fn places_are_found_on_their_side_of_every_split() {
        let mut tree = SpatialTree::new();
        assert_eq!(tree.find(&[9.0; 6]), 0);
        tree.split(0, 0, 1.0);
        tree.split(1, 1, 5.0);
        tree.split(0, 3, 0.0);
        let at = |x: f32, y: f32, nx: f32| tree.find(&[x, y, 0.0, nx, 0.0, 0.0]);
        assert_eq!((at(0.0, 9.0, -1.0), at(0.0, 9.0, 1.0), at(2.0, 0.0, 1.0), at(2.0, 5.0, 1.0)), (0, 3, 1, 2));
        assert_eq!(tree.owners.len(), 4);
    }

    #[test]
    fn records_are_parted_in_about_equal_halves_where_they_vary_most() {
        let mut spread = Spread::new();
        let point = |i: u32| to_unit(mix(i)) * 2.0;
        let places: Vec<Place> = (0..1000).map(|i| [1000.0 + point(i), 0.1 * point(i + 5000), 3.0, 0.0, 1.0, 0.0]).collect();
        places.iter().for_each(|p| spread.add(p));
        let (dimension, at) = spread.split(2.0).unwrap();
        let below = places.iter().filter(|p| p[dimension] < at).count();
        assert!(dimension == 0 && (450..550).contains(&below), "{dimension} {at} {below}");
        // σ of an even spread of 2 m is 0.577 m.
        assert!((spread.deviation().x - 0.577).abs() < 0.03 && spread.deviation().z == 0.0);
        // Floor and ceiling at one place differ in their normals.
        let mut spread = Spread::new();
        (0..100).for_each(|i| spread.add(&[0.0, 0.0, 0.0, 0.0, if i % 2 == 0 { 1.0 } else { -1.0 }, 0.0]));
        assert_eq!(spread.split(2.0), Some((4, 0.0)));
        let mut one = Spread::new();
        (0..100).for_each(|_| one.add(&[4.0; 6]));
        assert_eq!(one.split(2.0), None);
    }

    #[test]
    fn the_width_of_a_scene_does_not_mind_its_horizon() {
        let far = [1e6, 0.0, 1e6, 0.0, 1.0, 0.0];
        let mut places: Vec<Place> = (0..1001).map(|i| [i as f32 * 0.01, 0.0, 2.0, 0.0, 1.0, 0.0]).collect();
        places.extend([far; 100]);
        // A tenth of the records far away moves the medians by a twentieth.
        let width = width_of(places.iter());
        assert!((9.0..12.0).contains(&width), "{width}");
        assert_eq!(width_of([].iter()), 1.0);
    }
}
