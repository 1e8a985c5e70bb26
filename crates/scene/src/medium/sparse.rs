//! Numbers on a grid of which most is empty: blocks of 8³ values, and blocks of one value.

use super::blend::{NOTHING, ROUNDING, joined, trilinear};
use crate::bvh::Bounds;
use crate::exact::{Exact, Sink, Source, field};
use glam::{Affine3A, IVec3, Vec3};
use serde_json::Value;

/// Values along a side of a block; its logarithm to base 2.
const SIDE_LOG2: u32 = 3;
/// Values of a block.
pub const BLOCK: usize = 512;
/// Most blocks that a box may hold: 256 MB of numbers of blocks.
const MOST_BLOCKS: u64 = 1 << 26;
/// Marks the number of a block that holds one value.
const EVEN: u32 = 1 << 31;

/// Numbers at whole coordinates within a box, trilinear between them; `background` elsewhere.
#[derive(Clone, Debug)]
pub struct SparseGrid {
    index_from_own: Affine3A,
    /// The least and the greatest coordinates that are not background.
    box_min: IVec3,
    box_max: IVec3,
    /// First block, and how many there are along each axis.
    first: IVec3,
    count: IVec3,
    /// Number of each block in `values`, or of its one value in `even`.
    blocks: Vec<u32>,
    values: Vec<f32>,
    even: Vec<f32>,
}

impl SparseGrid {
    /// A grid that is background throughout a box of whole coordinates (both corners belong to it); `index_from_own` finds coordinates from
    /// places. Fails with the number of blocks where there would be too many of them, or none, as where a corner is below the other.
    pub fn new(index_from_own: Affine3A, box_min: IVec3, box_max: IVec3, background: f32) -> Result<Self, u64> {
        let first = box_min >> SIDE_LOG2;
        let span = |k: usize| i64::from(box_max[k] >> SIDE_LOG2) - i64::from(first[k]) + 1;
        let count = [span(0), span(1), span(2)];
        let total = count.iter().fold(1u64, |n, c| n.saturating_mul((*c).max(0) as u64));
        if !(1..=MOST_BLOCKS).contains(&total) {
            return Err(total);
        }
        let count = IVec3::from_array(count.map(|n| n as i32));
        Ok(SparseGrid {
            index_from_own,
            box_min,
            box_max,
            first,
            count,
            blocks: vec![EVEN; total as usize],
            values: Vec::new(),
            even: vec![background],
        })
    }

    fn block(&self, block: IVec3) -> Option<usize> {
        let b = block - self.first;
        let inside = b.cmpge(IVec3::ZERO).all() && b.cmplt(self.count).all();
        inside.then(|| (b.z as usize * self.count.y as usize + b.y as usize) * self.count.x as usize + b.x as usize)
    }

    /// Fills the block that begins at `origin` (multiples of 8): z first, then y, then x. Returns whether it lies in the box.
    pub fn set_block(&mut self, origin: IVec3, values: &[f32; BLOCK]) -> bool {
        let Some(i) = self.block(origin >> SIDE_LOG2) else { return false };
        match self.blocks[i] {
            number if number & EVEN == 0 => {
                let start = number as usize * BLOCK;
                self.values[start..start + BLOCK].copy_from_slice(values);
            }
            _ => {
                self.blocks[i] = (self.values.len() / BLOCK) as u32;
                self.values.extend_from_slice(values);
            }
        }
        true
    }

    /// How many blocks the box holds.
    pub fn block_count(&self) -> usize {
        self.blocks.len()
    }

    /// Gives all blocks of a cube (corner and side are multiples of 8), as far as it lies in the box, one value. Returns how many there are.
    pub fn fill(&mut self, origin: IVec3, side: i32, value: f32) -> usize {
        let number = EVEN | self.even.len() as u32;
        self.even.push(value);
        let low = (origin >> SIDE_LOG2).max(self.first);
        let high = ((origin >> SIDE_LOG2) + (side >> SIDE_LOG2)).min(self.first + self.count);
        let size = (high - low).max(IVec3::ZERO);
        for z in low.z..high.z {
            for y in low.y..high.y {
                for x in low.x..high.x {
                    if let Some(i) = self.block(IVec3::new(x, y, z)) {
                        self.blocks[i] = number;
                    }
                }
            }
        }
        size.to_array().iter().map(|n| *n as usize).product()
    }

    /// The box of its values in its own space, one value longer at the upper ends, as OpenVDB and pbrt count.
    pub fn bounds(&self) -> Bounds {
        let own_from_index = self.index_from_own.inverse();
        let around = Bounds { min: self.box_min.as_vec3(), max: self.box_max.as_vec3() + 1.0 };
        Bounds::around(around.corners().map(|c| own_from_index.transform_point3(c)))
    }

    /// Values along the axes of a box.
    pub(super) fn resolution(&self, bounds: &Bounds) -> [usize; 3] {
        let size = bounds.size();
        [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z].map(|edge| {
            let steps = self.index_from_own.transform_vector3(edge).abs().max_element();
            (steps as usize).clamp(1, 1 << 20)
        })
    }

    #[inline]
    fn value(&self, at: IVec3) -> f32 {
        let Some(i) = self.block(at >> SIDE_LOG2) else { return self.even[0] };
        let number = self.blocks[i];
        if number & EVEN != 0 {
            return self.even[(number & !EVEN) as usize];
        }
        let place = ((at.x & 7) << 6) | ((at.y & 7) << 3) | (at.z & 7);
        self.values[number as usize * BLOCK + place as usize]
    }

    /// The value at a place of its own space, linear between values; the background outside of its blocks.
    #[inline]
    pub fn at(&self, p: Vec3) -> f32 {
        let g = self.index_from_own.transform_point3(p);
        let base = g.floor();
        trilinear(base.as_ivec3(), g - base, 0.0, |at| Some(self.value(at)))
    }

    /// The least and the greatest value in a box of its own space.
    pub(super) fn limits(&self, cell: &Bounds) -> [f32; 2] {
        let around = Bounds::around(cell.corners().map(|c| self.index_from_own.transform_point3(c)));
        let low = (around.min - ROUNDING).floor().as_ivec3();
        let high = (around.max + ROUNDING).floor().as_ivec3() + 1;
        let (low_block, high_block) = (low >> SIDE_LOG2, high >> SIDE_LOG2);
        let (first, last) = (self.first, self.first + self.count - 1);
        let mut limits = NOTHING;
        if low_block.cmplt(first).any() || high_block.cmpgt(last).any() {
            limits = [self.even[0]; 2];
        }
        let (from, to) = (low_block.max(first), high_block.min(last));
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let block = IVec3::new(x, y, z);
                    let number = self.block(block).map_or(EVEN, |i| self.blocks[i]);
                    if number & EVEN != 0 {
                        limits = joined(limits, [self.even[(number & !EVEN) as usize]; 2]);
                        continue;
                    }
                    // The part of the block that the box holds.
                    let corner = block << SIDE_LOG2;
                    let (a, b) = ((low - corner).max(IVec3::ZERO), (high - corner).min(IVec3::splat(7)));
                    let values = &self.values[number as usize * BLOCK..(number as usize + 1) * BLOCK];
                    for i in a.x..=b.x {
                        for j in a.y..=b.y {
                            let row = &values[(i << 6 | j << 3) as usize..];
                            let row = &row[a.z as usize..=b.z as usize];
                            limits = row.iter().fold(limits, |l, v| joined(l, [*v; 2]));
                        }
                    }
                }
            }
        }
        limits
    }
}

impl Exact for SparseGrid {
    fn write(&self, sink: &mut Sink) -> Value {
        let numbers = |v: IVec3| v.to_array();
        let object = [
            ("index_from_own", self.index_from_own.write(sink)),
            ("box_min", numbers(self.box_min).write(sink)),
            ("box_max", numbers(self.box_max).write(sink)),
            ("blocks", self.blocks.write(sink)),
            ("values", self.values.write(sink)),
            ("even", self.even.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let corner = |name: &str| field::<[i32; 3]>(value, name, source).map(IVec3::from_array);
        let (box_min, box_max) = (corner("box_min")?, corner("box_max")?);
        if box_min.cmpgt(box_max).any() {
            return Err("a box without a size".into());
        }
        let plain =
            SparseGrid::new(field(value, "index_from_own", source)?, box_min, box_max, 0.0).map_err(|n| format!("{n} blocks"))?;
        let grid = SparseGrid {
            blocks: field(value, "blocks", source)?,
            values: field(value, "values", source)?,
            even: field(value, "even", source)?,
            ..plain
        };
        let is_there = |number: &u32| match number & EVEN == 0 {
            true => (*number as usize + 1) * BLOCK <= grid.values.len(),
            false => ((number & !EVEN) as usize) < grid.even.len(),
        };
        let count: i64 = grid.count.to_array().iter().map(|n| i64::from(*n)).product();
        let is_valid = |list: &[f32]| list.iter().all(|v| *v >= 0.0 && v.is_finite());
        if grid.blocks.len() as i64 != count
            || !grid.blocks.iter().all(is_there)
            || !is_valid(&grid.values)
            || !is_valid(&grid.even)
        {
            return Err("blocks that do not fit their box, or negative values".into());
        }
        Ok(grid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::{mix, to_unit};

    /// Blocks at odd places, a cube of one value, background elsewhere.
    fn grid() -> SparseGrid {
        let place = Affine3A::from_scale(Vec3::splat(2.0)) * Affine3A::from_rotation_y(0.4);
        let mut grid = SparseGrid::new(place, IVec3::new(-20, -5, 3), IVec3::new(30, 21, 18), 0.25).unwrap();
        let values = |seed: u32| std::array::from_fn(|i| to_unit(mix(seed * 512 + i as u32)));
        assert!(grid.set_block(IVec3::new(-16, 0, 8), &values(1)) && grid.set_block(IVec3::new(8, 8, 0), &values(2)));
        assert!(!grid.set_block(IVec3::new(64, 0, 0), &values(3)));
        // Two blocks along each axis, all of which reach into the box.
        assert_eq!(grid.fill(IVec3::new(16, 8, 8), 16, 0.75), 2 * 2 * 2);
        grid
    }

    #[test]
    fn values_are_found_where_they_were_put() {
        let grid = grid();
        let expected = |seed: u32, x: u32, y: u32, z: u32| to_unit(mix(seed * 512 + (x << 6 | y << 3 | z)));
        assert_eq!(grid.value(IVec3::new(-16 + 3, 5, 8 + 7)), expected(1, 3, 5, 7));
        assert_eq!(grid.value(IVec3::new(8, 15, 1)), expected(2, 0, 7, 1));
        assert_eq!([IVec3::new(16, 8, 8), IVec3::new(31, 23, 23)].map(|i| grid.value(i)), [0.75; 2]);
        assert_eq!([IVec3::new(0, 0, 8), IVec3::new(900, 0, 0), IVec3::splat(i32::MIN)].map(|i| grid.value(i)), [0.25; 3]);
        // Halfway between two.
        let p = grid.index_from_own.inverse().transform_point3(Vec3::new(-13.5, 5.0, 15.0));
        assert!((grid.at(p) - 0.5 * (expected(1, 2, 5, 7) + expected(1, 3, 5, 7))).abs() < 1e-3);
    }

    #[test]
    fn limits_hold_what_is_found() {
        let grid = grid();
        let b = grid.bounds();
        for i in 0..3000 {
            let u = |k: u32| to_unit(mix(i * 9 + k));
            let min = b.min + b.size() * Vec3::new(u(0), u(1), u(2));
            let cell = Bounds { min, max: min + 3.0 * Vec3::new(u(3), u(4), u(5)) };
            let [low, high] = grid.limits(&cell);
            let found = grid.at(min + cell.size() * Vec3::new(u(6), u(7), u(8)));
            assert!(low - 1e-5 <= found && found <= high + 1e-5, "{found} not in {low}..{high}");
        }
    }

    #[test]
    fn boxes_of_too_many_blocks_are_refused() {
        let far = IVec3::splat(1 << 20);
        assert!(SparseGrid::new(Affine3A::IDENTITY, IVec3::ZERO, far, 0.0).is_err_and(|n| n > MOST_BLOCKS));
        assert!(SparseGrid::new(Affine3A::IDENTITY, IVec3::MIN, IVec3::MAX, 0.0).is_err());
    }
}
