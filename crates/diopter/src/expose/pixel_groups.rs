//! Which pixels lend one another light ([`diopter_scene::Scene::trace_groups`]): a tile is divided into blocks, a block into cells, and of every cell each group of the block has one pixel, by chance.
//! Errors of a group's pixels are alike: so spread they look like noise, and most neighbours are of different groups. Two groups of a tile, a pair, are traced together.

use super::TILE;
use crate::camera::Film;
use diopter_light::random::mix;

/// Pixels of a group, in whole tiles.
pub(super) const GROUP: usize = 64;

/// Pixels of a film that records radiance, from which on blocks are whole tiles: on smaller ones a tile is a large part of the picture, and its pixels see different things. Not so of films that count electrons: what all
/// of a small block's pixels have in common is no noise to a filter, but a square that stays, in the colours of a mosaic.
const LARGE: usize = 1 << 17;

/// Pixels of a pair of groups, and pairs of a tile.
pub(super) const PAIR: usize = 2 * GROUP;
pub(super) const PAIRS: usize = TILE * TILE / PAIR;

/// Bits 0, 2 and 4 of a number, one after the other.
#[inline]
fn even_bits(number: usize) -> usize {
    number & 1 | number >> 1 & 2 | number >> 2 & 4
}

/// How tiles are divided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelGroups {
    /// Pixels a side of a block.
    block: usize,
    /// Columns and rows of a cell.
    cell: [usize; 2],
}

impl PixelGroups {
    /// Those of a film, and whether it records radiance.
    pub fn new(film: &Film, in_radiance: bool) -> Self {
        match in_radiance && film.columns * film.rows < LARGE {
            true => PixelGroups { block: TILE / 2, cell: [1, 1] },
            false => PixelGroups { block: TILE, cell: [2, 2] },
        }
    }

    /// Groups of a block, as many as a cell has pixels.
    fn groups_a_block(&self) -> usize {
        self.cell[0] * self.cell[1]
    }

    /// How the places of a cell are numbered: place p is of group (p a + b) mod n, where n divides 8, for an odd a, its own inverse modulo 8, and some b. `cell`: its column and row on the film.
    #[inline]
    fn numbering([column, row]: [usize; 2]) -> [usize; 2] {
        let hash = mix(mix(column as u32 ^ 0x9e37_79b9) ^ row as u32) as usize;
        [hash >> 4 & 6 | 1, hash & 7]
    }

    /// Column and row of a pixel of a group, by its number in it, in the tile with this first pixel; of tiles at the rim some lie beside the film. Pixels of like numbers are near one another: each
    /// power of two of them that follow one another, from a multiple of that on, lies in a square or half of one (Morton 1966).
    #[inline]
    fn pixel(&self, [left, top]: [usize; 2], group: usize, number: usize) -> [usize; 2] {
        let (n, [width, height]) = (self.groups_a_block(), self.cell);
        let (block, group) = (group / n, group % n);
        let blocks = TILE / self.block;
        let first = [left + block % blocks * self.block, top + block / blocks * self.block];
        let cell = [first[0] / width + even_bits(number), first[1] / height + even_bits(number >> 1)];
        let [odd, shift] = Self::numbering(cell);
        let place = (group + 8 - shift) * odd % n;
        [cell[0] * width + place % width, cell[1] * height + place / width]
    }

    /// The same of a pair of groups: pixels of one group before those of the other.
    #[inline]
    pub fn pixel_of_pair(&self, tile: [usize; 2], pair: usize, number: usize) -> [usize; 2] {
        self.pixel(tile, 2 * pair + number / GROUP, number % GROUP)
    }

    /// The group of a pixel: the first pixel of its block, and its number in the block.
    #[inline]
    pub fn of(&self, [x, y]: [usize; 2]) -> ([usize; 2], usize) {
        let [width, height] = self.cell;
        let [odd, shift] = Self::numbering([x / width, y / height]);
        let place = x % width + y % height * width;
        ([x / self.block * self.block, y / self.block * self.block], (place * odd + shift) % self.groups_a_block())
    }

    /// The pair of a pixel's group: the first pixel of its tile, and its number in the tile.
    #[inline]
    pub fn pair_of(&self, pixel: [usize; 2]) -> ([usize; 2], usize) {
        let ([left, top], group) = self.of(pixel);
        let (blocks, tile) = (TILE / self.block, [left, top].map(|at| at / TILE * TILE));
        let block = (left - tile[0]) / self.block + (top - tile[1]) / self.block * blocks;
        (tile, (block * self.groups_a_block() + group) / 2)
    }

    /// How many of the pixels of a pair, those of one group before those of the other, are of the group of the first of them.
    #[inline]
    pub fn len_of_first(&self, pixels: impl IntoIterator<Item = [usize; 2]>) -> usize {
        let mut pixels = pixels.into_iter().map(|pixel| self.of(pixel));
        let Some(first) = pixels.next() else { return 0 };
        1 + pixels.take_while(|group| *group == first).count()
    }

    /// A pixel that stands for the group of a pixel: one of its block, another one for each group.
    #[inline]
    pub fn representative(&self, pixel: [usize; 2]) -> [usize; 2] {
        let (first, group) = self.of(pixel);
        [first[0] + group, first[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn each_pixel_of_a_tile_belongs_to_one_group_and_groups_have_one_in_each_cell() {
        for (size, in_radiance, block) in
            [(64, true, 8), (240, true, 8), (640, true, TILE), (64, false, TILE), (240, false, TILE)]
        {
            let groups = PixelGroups::new(&Film::new(36.0, 24.0, size, size), in_radiance);
            assert_eq!(groups.block, block);
            for tile in [[0, 0], [TILE, 3 * TILE], [40 * TILE, 7 * TILE]] {
                let (mut seen, mut represented) = (HashSet::new(), HashSet::new());
                for group in 0..2 * PAIRS {
                    let pixels: Vec<[usize; 2]> = (0..GROUP).map(|number| groups.pixel(tile, group, number)).collect();
                    let cells: HashSet<[usize; 2]> =
                        pixels.iter().map(|[x, y]| [x / groups.cell[0], y / groups.cell[1]]).collect();
                    assert_eq!(cells.len(), GROUP);
                    assert!(pixels.iter().all(|p| groups.of(*p) == groups.of(pixels[0]) && seen.insert(*p)));
                    assert!(pixels.iter().all(|p| groups.pair_of(*p) == (tile, group / 2)));
                    // Parts are compact.
                    let of_part: HashSet<[usize; 2]> =
                        pixels[16..32].iter().map(|[x, y]| [x / groups.cell[0] / 4, y / groups.cell[1] / 4]).collect();
                    assert_eq!(of_part.len(), 1);
                    let representative = groups.representative(pixels[0]);
                    assert!(pixels.iter().all(|p| groups.representative(*p) == representative));
                    assert!(represented.insert(representative));
                }
                assert_eq!(seen.len(), TILE * TILE);
                assert!(seen.iter().all(|[x, y]| x / TILE == tile[0] / TILE && y / TILE == tile[1] / TILE));
            }
        }
    }

    #[test]
    fn neighbours_are_mostly_of_different_groups() {
        let groups = PixelGroups::new(&Film::new(36.0, 24.0, 640, 640), true);
        let all = (0..64).flat_map(|y| (0..64).map(move |x| [x, y]));
        let same = all.filter(|[x, y]| groups.of([*x, *y]) == groups.of([x + 1, *y])).count();
        // Within a cell none, between cells one in four: of 4096 pairs half are between cells, fewer between tiles.
        assert!((300..700).contains(&same), "{same}");
    }
}
