//! Which pixels of a tile lend one another light ([`diopter_scene::Scene::radiance_of_group`]): of every cell of 4 × 4 pixels each group has one, by chance. Errors of a group's
//! pixels are alike: so spread they look like noise, and neighbors are of different groups.

use super::TILE;
use diopter_light::random::mix;

/// Pixels a side of a cell.
const CELL: usize = 4;

/// Groups of a tile.
pub(super) const GROUPS: usize = CELL * CELL;
/// Pixels of a group in a whole tile.
pub(super) const GROUP: usize = TILE * TILE / GROUPS;

/// Cells of a tile across.
const CELLS: usize = TILE / CELL;

/// How the places of a cell are numbered: place p is of group (p a + b) mod 16, for a pair of an odd number and its inverse, and b. `cell`: its column and row on the film.
#[inline]
fn numbering([column, row]: [usize; 2]) -> [usize; 3] {
    const ODD: [[usize; 2]; 8] = [[1, 1], [3, 11], [5, 13], [7, 7], [9, 9], [11, 3], [13, 5], [15, 15]];
    let hash = mix(mix(column as u32 ^ 0x9e37_79b9) ^ row as u32) as usize;
    let [factor, inverse] = ODD[hash >> 4 & 7];
    [factor, inverse, hash & 15]
}

/// Column and row of a pixel of a group, by its number in it, in the tile with this first pixel; of tiles at the rim some lie beside the film.
#[inline]
pub(super) fn pixel_of_group(tile: [usize; 2], group: usize, number: usize) -> [usize; 2] {
    let cell = [tile[0] / CELL + number % CELLS, tile[1] / CELL + number / CELLS];
    let [_, inverse, shift] = numbering(cell);
    let place = (group + GROUPS - shift) * inverse % GROUPS;
    [cell[0] * CELL + place % CELL, cell[1] * CELL + place / CELL]
}

/// First pixel of the tile of a pixel, and the group to which the pixel belongs there.
#[inline]
pub(super) fn group_of(pixel: [usize; 2]) -> ([usize; 2], usize) {
    let [factor, _, shift] = numbering(pixel.map(|at| at / CELL));
    let place = pixel[0] % CELL + pixel[1] % CELL * CELL;
    (pixel.map(|at| at / TILE * TILE), (place * factor + shift) % GROUPS)
}

/// A pixel that stands for the group of a pixel: one of its tile, another one for each group.
#[inline]
pub(super) fn representative(pixel: [usize; 2]) -> [usize; 2] {
    let (tile, group) = group_of(pixel);
    [tile[0] + group % CELL, tile[1] + group / CELL]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn each_pixel_of_a_tile_belongs_to_one_group_and_groups_have_one_in_each_cell() {
        for tile in [[0, 0], [TILE, 3 * TILE], [40 * TILE, 7 * TILE]] {
            let mut seen = HashSet::new();
            for group in 0..GROUPS {
                let pixels: Vec<[usize; 2]> = (0..GROUP).map(|number| pixel_of_group(tile, group, number)).collect();
                let cells: HashSet<[usize; 2]> = pixels.iter().map(|p| p.map(|at| at / CELL)).collect();
                assert_eq!(cells.len(), GROUP);
                assert!(pixels.iter().all(|p| group_of(*p) == (tile, group) && seen.insert(*p)));
                let representatives: HashSet<[usize; 2]> = pixels.iter().map(|p| representative(*p)).collect();
                assert_eq!(representatives.len(), 1);
            }
            assert_eq!(seen.len(), TILE * TILE);
        }
    }
}
