//! pbrt-v4's text format into a [`Description`].
//!
//! `lex` tokens → `params` typed lists → `world` the directives and their state → `shapes`, `materials`, `textures`, `spectra`, `media` (`medium_fields`, `nanovdb`, `subsurface`), `lights`,
//! `camera`, which get a `context`: files, warnings, where things stand, what has been described. What is not supported is an error where the picture would be wrong and a warning where it would not. Files are opened by the
//! caller; names count from the folder of the main file, as in pbrt.
//!
//! Units: a scene unit is a metre; a light of `scale` 1 has 1 cd/m² (pbrt divides every light by ∫ȳ L dλ, and its `power` and `illuminance`
//! mean lumens and lux), so pictures in cd/m² are pbrt's RGB. pbrt's camera is left-handed: a world that is, too, is mirrored (z → −z).
//!
//! Sources: pbrt-v4's file format and behaviour, M. Pharr, W. Jakob & G. Humphreys 2023, "Physically Based Rendering", 4th ed.

mod camera;
mod context;
mod lex;
mod lights;
mod materials;
mod media;
mod medium_fields;
mod nanovdb;
mod params;
pub(super) mod shapes;
mod spectra;
mod subsurface;
mod textures;
mod world;

use crate::SceneError;
use crate::load::{Fetch, finished};
use crate::scene::Description;

/// Number of a file among those read, and a line in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    file: u32,
    line: u32,
}

/// What is wrong where; becomes a [`SceneError`] when the file's name is known.
#[derive(Clone, Debug)]
pub struct Fault {
    place: Place,
    found: String,
    expected: String,
}

impl Place {
    fn fault(self, found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault { place: self, found: found.into(), expected: expected.into() }
    }

    /// What only files of pbrt-v3 have, and what converts them. Source: pbrt-v4's `parser.cpp` (`FormattingParserTarget`).
    fn version_3(self, found: impl Into<String>) -> Fault {
        let converter = "pbrt-v4; its own program converts: pbrt --upgrade old.pbrt > new.pbrt";
        self.fault(format!("{}: this is pbrt-v3", found.into()), converter)
    }
}

/// Reads a scene. `name` stands for the main file in messages; `fetch` gets files by the names in it. Fails with the file and line of the first thing that is wrong:
/// text, a directive or type that is not known, a value out of range, a name or file that is not there; and where nothing has a surface.
pub fn load(bytes: &[u8], name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let mut world = world::World::new(name, fetch);
    let description = match world.read_main(bytes) {
        Ok(()) => world.finish()?,
        Err(fault) => return Err(world.context.error(fault)),
    };
    finished(description, name, "a Shape with a material after WorldBegin")
}
