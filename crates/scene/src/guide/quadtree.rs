//! A density over directions that is learnt: a quadtree over the sphere.
//!
//! The sphere is mapped to the unit square by a cylindrical equal-area projection about z, (x, y) = ((1 + cos θ) / 2, φ / 2π). Cells are refined
//! where the density is large, so that each holds about the same mass. Source: T. Müller, M. Gross, J. Novák 2017, "Practical Path Guiding
//! for Efficient Light-Transport Simulation", with the density proportional to the square root of the second moment of the light, which
//! has the least variance when estimates of the light are noisy (A. Rath et al. 2020, "Variance-Aware Path Guiding"). Limit: the density is
//! constant within a cell.

use glam::Vec3;
use std::collections::VecDeque;
use std::f32::consts::{FRAC_1_PI, TAU};

/// Levels below the root: the smallest cell is 4⁻¹⁰ of the sphere (1.2e-5 sr, a disk of 0.2° across).
const MOST_LEVELS: u32 = 10;
/// Nodes of a tree: 10 KB with its moments.
const MOST_NODES: usize = 256;
/// A cell is divided if it holds more than this fraction of the mass (Müller et al. 2017: ρ = 0.01).
const LARGEST_MASS: f32 = 0.01;
/// Records that a cell must stand for on average before it is divided, so that few records do not make deep trees of noise. Chosen, not tuned.
const RECORDS_A_CELL: f32 = 8.0;
/// The largest number below 1 in single precision.
pub(super) const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Four quadrants of a cell: first and second half of x, then the same in the second half of y.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    mass: [f32; 4],
    /// Node of the quadrant; 0 (the root is nobody's child) where it is not divided.
    child: [u16; 4],
}

/// A density over directions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Quadtree {
    nodes: Vec<Node>,
}

/// Second moments of the light that arrives through the undivided cells of a tree: sums of L² / pdf over records, by node and quadrant.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moments {
    cells: Vec<[f32; 4]>,
    /// Records that they stand for; what was learnt earlier counts less.
    pub records: f32,
}

impl Quadtree {
    /// The same density everywhere.
    pub fn uniform() -> Self {
        Quadtree { nodes: vec![Node { mass: [1.0; 4], child: [0; 4] }] }
    }

    /// Draws a direction; its density, 1/sr. Keeps the strata of `u` together.
    #[inline]
    pub fn sample(&self, mut u: [f32; 2]) -> (Vec3, f32) {
        let (mut corner, mut size, mut density) = ([0.0f32; 2], 1.0f32, 1.0f32);
        let mut node = &self.nodes[0];
        loop {
            let m = &node.mass;
            let left = m[0] + m[2];
            let (column, x) = choose(u[0], left / (left + m[1] + m[3]));
            let (row, y) = choose(u[1], m[column] / (m[column] + m[column + 2]));
            let quadrant = column + 2 * row;
            density *= 4.0 * m[quadrant] / (m[0] + m[2] + m[1] + m[3]);
            u = [x, y];
            size *= 0.5;
            corner = [corner[0] + size * column as f32, corner[1] + size * row as f32];
            match node.child[quadrant] {
                0 => break,
                child => node = &self.nodes[usize::from(child)],
            }
        }
        (direction_of([corner[0] + size * u[0], corner[1] + size * u[1]]), density * PER_STERADIAN)
    }

    /// Density of a direction, 1/sr.
    #[inline]
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.pdf_at(square_of(direction))
    }

    /// Density, 1/sr, of the direction that lies at a point of the square.
    pub fn pdf_at(&self, mut p: [f32; 2]) -> f32 {
        let (mut node, mut density) = (&self.nodes[0], PER_STERADIAN);
        loop {
            let m = &node.mass;
            let quadrant = descend(&mut p);
            if m[quadrant] == 0.0 {
                return 0.0;
            }
            // Summed as in `sample`, for the same bits.
            density *= 4.0 * m[quadrant] / (m[0] + m[2] + m[1] + m[3]);
            match node.child[quadrant] {
                0 => return density,
                child => node = &self.nodes[usize::from(child)],
            }
        }
    }

    /// Node, quadrant and width of the undivided cell around a point of the square.
    fn cell(&self, mut p: [f32; 2]) -> (usize, usize, f32) {
        let (mut node, mut size) = (0, 0.5);
        loop {
            let quadrant = descend(&mut p);
            match self.nodes[node].child[quadrant] {
                0 => return (node, quadrant, size),
                child => (node, size) = (usize::from(child), 0.5 * size),
            }
        }
    }

    /// Bytes that it takes.
    pub fn memory(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
    }

    /// A tree whose cells fit what was learnt in those of this one, with its moments; `None` while there was no light.
    pub fn refined(&self, moments: &Moments) -> Option<(Quadtree, Moments)> {
        // Of each node: moment and mass. Children come after their parents.
        let mut levels = vec![1u32; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            for child in node.child.into_iter().filter(|c| *c != 0) {
                levels[usize::from(child)] = levels[i] + 1;
            }
        }
        let mut wholes = vec![Cell { moment: 0.0, mass: 0.0 }; self.nodes.len()];
        for i in (0..self.nodes.len()).rev() {
            for quadrant in 0..4 {
                let cell = match self.nodes[i].child[quadrant] {
                    0 => Cell::new(moments.cells[i][quadrant], levels[i]),
                    child => wholes[usize::from(child)],
                };
                wholes[i].moment += cell.moment;
                wholes[i].mass += cell.mass;
            }
        }
        let total = wholes[0].mass;
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let largest = total * LARGEST_MASS.max(RECORDS_A_CELL / moments.records.max(1.0));

        // From the root down, wide before deep, so that a limit on nodes takes the deepest.
        let empty = Node { mass: [0.0; 4], child: [0; 4] };
        let (mut nodes, mut cells) = (vec![empty], vec![[0.0; 4]]);
        let mut queue = VecDeque::from([(0usize, Source::Node(0), 1u32)]);
        while let Some((place, source, level)) = queue.pop_front() {
            for quadrant in 0..4 {
                let (below, cell) = match source {
                    Source::Node(i) => match self.nodes[i].child[quadrant] {
                        0 => {
                            let moment = moments.cells[i][quadrant];
                            (Source::Even(moment), Cell::new(moment, level))
                        }
                        child => (Source::Node(usize::from(child)), wholes[usize::from(child)]),
                    },
                    Source::Even(moment) => (Source::Even(0.25 * moment), Cell::new(0.25 * moment, level)),
                };
                if cell.mass > largest && level < MOST_LEVELS && nodes.len() < MOST_NODES {
                    nodes[place].child[quadrant] = nodes.len() as u16;
                    queue.push_back((nodes.len(), below, level + 1));
                    nodes.push(empty);
                    cells.push([0.0; 4]);
                } else {
                    cells[place][quadrant] = cell.moment;
                    nodes[place].mass[quadrant] = Cell::new(cell.moment, level).mass;
                }
            }
        }
        for i in (0..nodes.len()).rev() {
            for quadrant in 0..4 {
                if nodes[i].child[quadrant] != 0 {
                    nodes[i].mass[quadrant] = nodes[usize::from(nodes[i].child[quadrant])].mass.iter().sum();
                }
            }
        }
        Some((Quadtree { nodes }, Moments { cells, records: moments.records }))
    }
}

/// What a cell is made of when trees are rebuilt: a node of the old tree, or a part of an undivided cell with its moment.
#[derive(Clone, Copy)]
enum Source {
    Node(usize),
    Even(f32),
}

#[derive(Clone, Copy)]
struct Cell {
    moment: f32,
    mass: f32,
}

impl Cell {
    /// A cell so many levels below the whole: its density is √(moment / area), its mass that times the area.
    fn new(moment: f32, level: u32) -> Self {
        let area = 0.25f32.powi(level as i32);
        Cell { moment, mass: (moment * area).sqrt() }
    }
}

impl Moments {
    /// Nothing learnt yet of a tree.
    pub fn none(tree: &Quadtree) -> Self {
        Moments { cells: vec![[0.0; 4]; tree.nodes.len()], records: 0.0 }
    }

    /// Adds L² / pdf of a record, somewhere within half a cell of its place: a stochastic filter, against the cells' borders (T. Müller 2019, "Practical
    /// Path Guiding in Production", course notes). `jitter` is uniform in [0, 1)².
    pub fn add(&mut self, tree: &Quadtree, place: [f32; 2], value: f32, jitter: [f32; 2]) {
        let size = tree.cell(place).2;
        let x = place[0] + size * (jitter[0] - 0.5);
        // The poles are ends, the angle goes round.
        let x = if x < 0.0 { -x } else { x };
        let x = if x >= 1.0 { 2.0 - x } else { x };
        let y = (place[1] + size * (jitter[1] - 0.5)).rem_euclid(1.0);
        let (node, quadrant, _) = tree.cell([x.clamp(0.0, BELOW_ONE), y.min(BELOW_ONE)]);
        self.cells[node][quadrant] += value;
        self.records += 1.0;
    }

    /// Lets what was learnt count by a factor.
    pub fn scale(&mut self, factor: f32) {
        self.cells.iter_mut().flatten().for_each(|m| *m *= factor);
        self.records *= factor;
    }
}

/// 1 / 4π: density in solid angle of an even one over the square.
pub(super) const PER_STERADIAN: f32 = 0.25 * FRAC_1_PI;

/// One of two parts, the first with a probability, and `u` stretched within it.
#[inline]
fn choose(u: f32, first: f32) -> (usize, f32) {
    if u < first { (0, (u / first).min(BELOW_ONE)) } else { (1, ((u - first) / (1.0 - first)).min(BELOW_ONE)) }
}

/// The quadrant of a point of the square, and the point in its own square.
#[inline]
fn descend(p: &mut [f32; 2]) -> usize {
    let mut quadrant = 0;
    for (k, x) in p.iter_mut().enumerate() {
        *x *= 2.0;
        if *x >= 1.0 {
            *x -= 1.0;
            quadrant |= 1 << k;
        }
    }
    quadrant
}

/// Where a unit direction lies in the square, [0, 1)².
#[inline]
pub(super) fn square_of(d: Vec3) -> [f32; 2] {
    let turn = d.y.atan2(d.x) / TAU;
    let turn = if turn < 0.0 { turn + 1.0 } else { turn };
    [(0.5 * (d.z + 1.0)).clamp(0.0, BELOW_ONE), turn.clamp(0.0, BELOW_ONE)]
}

/// The direction at a point of the square.
#[inline]
fn direction_of(p: [f32; 2]) -> Vec3 {
    let z = 2.0 * p[0] - 1.0;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * p[1]).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    fn uniform(i: u32, k: u32) -> f32 {
        to_unit(mix(i.wrapping_mul(9).wrapping_add(k) ^ 0x51ed_270b))
    }

    /// A tree that has learnt from some records a light that is `light` at a point of the square.
    pub fn learnt(light: impl Fn([f32; 2]) -> f32, rounds: u32, records: u32) -> Quadtree {
        let mut tree = Quadtree::uniform();
        let mut moments = Moments::none(&tree);
        for round in 0..rounds {
            for i in 0..records {
                let n = round * records + i;
                let place = [uniform(n, 0), uniform(n, 1)];
                let value = light(place);
                moments.add(&tree, place, value * value / PER_STERADIAN, [uniform(n, 2), uniform(n, 3)]);
            }
            (tree, moments) = tree.refined(&moments).expect("there is light");
            moments.scale(0.5);
        }
        tree
    }

    /// A bright spot, dim light in one half, darkness in the other.
    fn spot([x, y]: [f32; 2]) -> f32 {
        if (x - 0.62).abs() < 0.02 && (y - 0.31).abs() < 0.02 { 100.0 } else { f32::from(u8::from(y < 0.5)) }
    }

    #[test]
    fn directions_and_points_of_the_square_are_inverse() {
        for i in 0..2000 {
            let p = [uniform(i, 0), uniform(i, 1)];
            let q = square_of(direction_of(p));
            // Near the poles the angle is uncertain by rounding.
            let r = (1.0 - (2.0 * p[0] - 1.0).powi(2)).sqrt();
            assert!((p[0] - q[0]).abs() < 1e-6 && (p[1] - q[1]).abs() * r < 1e-5, "{p:?} {q:?}");
        }
        for d in [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::NEG_X, Vec3::new(1.0, -1e-9, 0.0)] {
            assert!(square_of(d).iter().all(|v| (0.0..1.0).contains(v)), "{d}");
        }
    }

    #[test]
    fn a_learnt_density_integrates_to_one_and_follows_the_light() {
        let tree = learnt(spot, 6, 4000);
        let n = 1024;
        let (mut integral, mut bright, mut dark) = (0.0f64, 0.0f64, 0.0f64);
        for i in 0..n {
            for j in 0..n {
                let p = [(i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32];
                // Over the square, whose area stands for 4π.
                let pdf = f64::from(tree.pdf_at(p) / PER_STERADIAN) / f64::from(n * n);
                integral += pdf;
                bright += if spot(p) > 50.0 { pdf } else { 0.0 };
                dark += if p[1] > 0.55 && p[1] < 0.95 { pdf } else { 0.0 };
            }
        }
        // Products of quotients that sum to one at each node: rounding alone.
        assert!((integral - 1.0).abs() < 1e-4, "{integral}");
        // By the light the spot has 100 × 0.0016 of 0.66: a quarter. Even records find it a few times a round only, and the filter blurs it: of
        // the order of a tenth is expected; a uniform density has 0.0016.
        assert!(bright > 0.03, "{bright}");
        // Darkness (0.4 of the square) has what the filter carried over the borders of cells while they were large.
        assert!(dark < 0.15, "{dark}");
    }

    #[test]
    fn samples_follow_their_density_by_chi_square() {
        let tree = learnt(spot, 5, 4000);
        const SIDE: usize = 16;
        let mut counts = vec![0.0f64; SIDE * SIDE];
        let draws = 100_000;
        for i in 0..draws {
            let (d, pdf) = tree.sample([uniform(i, 5), uniform(i, 6)]);
            assert!((d.length() - 1.0).abs() < 1e-5 && pdf > 0.0);
            let p = square_of(d);
            // By rounding a few lie in the next cell.
            counts[(p[0] * SIDE as f32) as usize * SIDE + (p[1] * SIDE as f32) as usize] += 1.0;
        }
        let sub = 64;
        let (mut chi2, mut bins) = (0.0, 0.0);
        for (cell, count) in counts.iter().enumerate() {
            let mut mass = 0.0f64;
            for i in 0..sub * sub {
                let at = |k: usize, i: usize| (k as f32 + (i as f32 + 0.5) / sub as f32) / SIDE as f32;
                mass += f64::from(tree.pdf_at([at(cell / SIDE, i / sub), at(cell % SIDE, i % sub)]) / PER_STERADIAN);
            }
            let expected = mass / (sub * sub * SIDE * SIDE) as f64 * f64::from(draws);
            if expected > 5.0 {
                chi2 += (count - expected).powi(2) / expected;
                bins += 1.0f64;
            }
        }
        // Four deviations of χ² and a little: by chance less than once in ten thousand seeds.
        assert!(chi2 < bins + 4.0 * (2.0 * bins).sqrt() + 8.0, "χ² {chi2} of {bins} bins");
    }

    #[test]
    fn the_density_of_a_sample_is_that_of_its_direction() {
        let tree = learnt(spot, 4, 3000);
        let mut off = 0;
        for i in 0..20_000 {
            let (d, pdf) = tree.sample([uniform(i, 7), uniform(i, 8)]);
            off += usize::from((tree.pdf(d) / pdf - 1.0).abs() > 1e-3);
        }
        // Directions are rounded to 1e-7, cells are at least 1e-3 wide: one of thousands falls to a neighbour.
        assert!(off < 40, "{off}");
    }

    #[test]
    fn trees_are_bounded_and_learn_nothing_from_darkness() {
        let tree = Quadtree::uniform();
        assert!(tree.refined(&Moments::none(&tree)).is_none());
        // Light at many points asks for more nodes than there may be.
        let tree = learnt(|p| if mix((p[0] * 64.0) as u32 * 64 + (p[1] * 64.0) as u32) % 7 == 0 { 50.0 } else { 1e-3 }, 8, 8000);
        assert!(tree.nodes.len() <= MOST_NODES);
        // One record alone must not make a deep tree.
        let mut moments = Moments::none(&Quadtree::uniform());
        moments.add(&Quadtree::uniform(), [0.3, 0.3], 1.0, [0.5; 2]);
        let (tree, _) = Quadtree::uniform().refined(&moments).unwrap();
        assert_eq!(tree.nodes.len(), 1);
    }
}
