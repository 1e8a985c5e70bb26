//! Pictures in tiles: a file for each unit square of texture coordinates, numbered 1001 + column + 10 · row from the lower left (UDIM). They become one
//! picture, which is looked up and filtered as any other.
//!
//! Sources: OpenUSD, UsdUVTexture (`<UDIM>` in an asset path, tiles 1001 to 1100); MaterialX 1.39, "Filename Substitutions" (also `<UVTILE>`, as
//! "u1_v1").

use super::read_texture;
use crate::texture::levels::linear;
use crate::texture::{Codes, Image, Texel, Texels, Wrap};
use glam::{Affine2, Vec2, Vec4};
use std::sync::Arc;

/// What stands for the tile in a name.
const MARKS: [&str; 2] = ["<UDIM>", "<UVTILE>"];

/// The name of the tile in a column and a row, both from 0.
fn tile_name(name: &str, column: usize, row: usize) -> String {
    let [number, place] = [format!("{}", 1001 + column + ACROSS * row), format!("u{}_v{}", column + 1, row + 1)];
    name.replace(MARKS[0], &number).replace(MARKS[1], &place)
}

/// Tiles in a row, and rows.
const ACROSS: usize = 10;

/// Pixels of all tiles together; beyond, each is halved until they fit.
const MOST_PIXELS: usize = 1 << 28;

/// A picture of a texture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Its pixels, of all tiles where it has some.
    pub image: Arc<Image>,
    /// Where it lies from where a picture lies that fills the unit square (rows from the top); the identity without tiles.
    pub image_from_unit: Affine2,
    is_tiled: bool,
}

impl From<Arc<Image>> for Picture {
    fn from(image: Arc<Image>) -> Self {
        Picture { image, image_from_unit: Affine2::IDENTITY, is_tiled: false }
    }
}

impl Picture {
    /// How it goes on beyond its edges, where a file asks for `wrap`: tiles have no copies of themselves.
    pub fn wrap(&self, wrap: [Wrap; 2]) -> [Wrap; 2] {
        if self.is_tiled { [Wrap::Clamp; 2] } else { wrap }
    }
}

/// Reads the picture of a name, or the tiles of a name with a mark in it. Tiles smaller than the largest are enlarged, places without one are black. Fails
/// with the reason where there is no file or it cannot be read.
pub fn read(name: &str, bytes: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Picture, String> {
    if !MARKS.iter().any(|mark| name.contains(mark)) {
        return Ok(Arc::new(read_texture(&bytes(name)?)?).into());
    }
    let (image, image_from_unit) = joined(name, MOST_PIXELS, &mut |tile| bytes(tile).ok().map(|found| read_texture(&found)))?;
    Ok(Picture { image: Arc::new(image), image_from_unit, is_tiled: true })
}

/// All tiles in one picture, and where it lies. `read` gives the tile of a name, nothing where there is none.
fn joined(
    name: &str,
    most_pixels: usize,
    read: &mut dyn FnMut(&str) -> Option<Result<Image, String>>,
) -> Result<(Image, Affine2), String> {
    let mut tiles = Vec::new();
    for place @ [column, row] in (0..ACROSS * ACROSS).map(|i| [i % ACROSS, i / ACROSS]) {
        let tile = tile_name(name, column, row);
        if let Some(found) = read(&tile) {
            tiles.push((place, found.map_err(|reason| format!("{tile}: {reason}"))?));
        }
    }
    let range = |axis: usize| {
        let places = tiles.iter().map(|(place, _)| place[axis]);
        Some((places.clone().min()?, places.max()?))
    };
    let Some(([left, right], [bottom, top])) = range(0).zip(range(1)).map(|(u, v)| ([u.0, u.1], [v.0, v.1])) else {
        return Err("none of its tiles 1001 to 1100 is there".to_owned());
    };
    let (across, up) = (right - left + 1, top - bottom + 1);
    let mut cell = [tiles.iter().map(|t| t.1.width).max(), tiles.iter().map(|t| t.1.height).max()].map(|n| n.unwrap_or(1).max(1));
    while cell[0] * cell[1] * across * up > most_pixels && cell[0].max(cell[1]) > 1 {
        cell = cell.map(|n| n.div_ceil(2));
    }
    let size = [across * cell[0], up * cell[1]];
    let image = |texels| Image::of_texels(size[0], size[1], texels);
    let texels = tiles.iter().map(|(_, tile)| tile.texel(0, 0));
    let places = tiles.iter().map(|(place, tile)| ([(place[0] - left) * cell[0], (top - place[1]) * cell[1]], tile));
    let all = size[0] * size[1];
    let image = if texels.clone().all(|t| matches!(t, Texel::Codes(_))) {
        let mut codes = vec![[0, 0, 0, 255]; all];
        places.for_each(|(corner, tile)| {
            fill(&mut codes, size[0], corner, cell, tile, |v| v.to_array().map(|v| (255.0 * v).round() as u8))
        });
        image(Texels::Codes(codes))
    } else if texels.clone().all(|t| matches!(t, Texel::Codes(_) | Texel::Codes16(_))) {
        let mut codes = vec![[0, 0, 0, u16::MAX]; all];
        let code = |v: Vec4| v.to_array().map(|v| (65535.0 * v).round() as u16);
        places.for_each(|(corner, tile)| fill(&mut codes, size[0], corner, cell, tile, code));
        image(Texels::Codes16(codes))
    } else if texels.clone().all(|t| matches!(t, Texel::Linear(_))) {
        let mut numbers = vec![[0.0, 0.0, 0.0, 1.0]; all];
        places.for_each(|(corner, tile)| fill(&mut numbers, size[0], corner, cell, tile, |v| v.to_array()));
        image(Texels::Linear(numbers))
    } else {
        return Err("some of its tiles are of floating point, others of codes".to_owned());
    };
    // Rows of tiles count from below, rows of pixels from the top: the tile 1001 alone is the unit square.
    let shift = Vec2::new(-(left as f32), top as f32);
    let scale = Vec2::new(across as f32, up as f32).recip();
    Ok((image, Affine2::from_scale(scale) * Affine2::from_translation(shift)))
}

/// Writes a tile into its cell of a larger picture, bilinear where its size is another one.
fn fill<T>(all: &mut [T], width: usize, corner: [usize; 2], cell: [usize; 2], tile: &Image, to: impl Fn(Vec4) -> T) {
    // As they are stored: codes stay codes.
    let value = |column: usize, row: usize| linear(tile.texel(column, row), Codes::Linear);
    let is_whole = [tile.width, tile.height] == cell;
    for row in 0..cell[1] {
        for column in 0..cell[0] {
            let value = if is_whole {
                value(column, row)
            } else {
                let axis = |i: usize, n: usize, cell: usize| {
                    let p = ((i as f32 + 0.5) * n as f32 / cell as f32 - 0.5).clamp(0.0, (n - 1) as f32);
                    (p as usize, (p as usize + 1).min(n - 1), p.fract())
                };
                let ((x0, x1, fx), (y0, y1, fy)) = (axis(column, tile.width, cell[0]), axis(row, tile.height, cell[1]));
                value(x0, y0).lerp(value(x1, y0), fx).lerp(value(x0, y1).lerp(value(x1, y1), fx), fy)
            };
            all[(corner[1] + row) * width + corner[0] + column] = to(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Interpolation, Texture};

    fn even(size: usize, code: u8) -> Image {
        Image::new(size, size, vec![[code, 0, 0, 255]; size * size])
    }

    /// Red at mesh coordinates (v up).
    fn red(image: &Image, from_tile: Affine2, u: f32, v: f32) -> f32 {
        let flip = Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y);
        let texture = Texture {
            codes: Codes::Linear,
            interpolation: Interpolation::Nearest,
            image_from_uv: from_tile * flip,
            ..Texture::color(image.clone().into())
        };
        (255.0 * texture.at(&[Vec2::new(u, v); 2]).x).round()
    }

    #[test]
    fn tiles_lie_where_their_numbers_say() {
        let mut asked = 0;
        let mut read = |name: &str| {
            asked += 1;
            // The second and third of the first row, the second of the third; one of another size.
            [("a.1002.png", 2, 20), ("a.1003.png", 4, 30), ("a.1022.png", 4, 40)]
                .iter()
                .find(|t| t.0 == name)
                .map(|t| Ok(even(t.1, t.2)))
        };
        let (image, from_tile) = joined("a.<UDIM>.png", MOST_PIXELS, &mut read).unwrap();
        assert_eq!(asked, 100);
        assert_eq!([image.width, image.height], [8, 12]);
        let at = |u, v| red(&image, from_tile, u, v);
        assert_eq!([at(1.1, 0.1), at(1.9, 0.9), at(2.5, 0.5), at(1.5, 2.5)], [20.0, 20.0, 30.0, 40.0]);
        // Nothing between them.
        assert_eq!([at(1.5, 1.5), at(2.5, 2.5)], [0.0, 0.0]);
    }

    #[test]
    fn a_single_first_tile_is_the_picture_itself() {
        let picture = Image::new(2, 1, vec![[1, 0, 0, 255], [2, 0, 0, 255]]);
        let (image, from_tile) = joined("t<UDIM>", MOST_PIXELS, &mut |n| (n == "t1001").then(|| Ok(picture.clone()))).unwrap();
        assert_eq!((from_tile, image.texel(1, 0)), (Affine2::IDENTITY, Texel::Codes([2, 0, 0, 255])));
        let (image, _) = joined("t<UVTILE>", MOST_PIXELS, &mut |n| (n == "tu2_v3").then(|| Ok(picture.clone()))).unwrap();
        assert_eq!([image.width, image.height], [2, 1]);
    }

    #[test]
    fn too_many_pixels_are_halved_and_what_cannot_be_joined_is_said() {
        let two = |other: Image| {
            move |n: &str| ["t1001", "t1011"].iter().position(|t| *t == n).map(|i| Ok([even(8, 9), other.clone()][i].clone()))
        };
        let (image, _) = joined("t<UDIM>", 40, &mut two(even(8, 9))).unwrap();
        assert_eq!([image.width, image.height], [4, 8]);
        assert!((0..8).all(|row| image.texel(1, row) == Texel::Codes([9, 0, 0, 255])));
        // More bits than the other tile has.
        let (image, _) = joined("t<UDIM>", MOST_PIXELS, &mut two(Image::of_codes16(1, 1, vec![[7, 0, 0, 65535]]))).unwrap();
        assert_eq!(
            (image.texel(0, 0), image.texel(0, 15)),
            (Texel::Codes16([7, 0, 0, 65535]), Texel::Codes16([9 * 257, 0, 0, 65535]))
        );
        let e = joined("t<UDIM>", MOST_PIXELS, &mut two(Image::linear(1, 1, vec![[7.0; 4]]))).unwrap_err();
        assert!(e.contains("floating point"), "{e}");
        assert!(joined("t<UDIM>", MOST_PIXELS, &mut |_| None).unwrap_err().contains("1001 to 1100"));
        let e = joined("t<UDIM>", MOST_PIXELS, &mut |n| (n == "t1005").then(|| Err("damaged".to_owned()))).unwrap_err();
        assert_eq!(e, "t1005: damaged");
    }
}
