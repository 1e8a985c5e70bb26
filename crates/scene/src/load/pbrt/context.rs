//! What readers of parts ask of the scene in the making: files, warnings, where things stand, and what has been described so far.

use super::params::Params;
use super::{Fault, Place};
use crate::SceneError;
use crate::load::{Fetch, measured_or_stand_in, note_missing, read_texture, unzipped};
use crate::material::Scattering;
use crate::medium::VolumePlace;
use crate::motion::Parts;
use crate::scene::Description;
use crate::texture::Image;
use glam::{Affine3A, DMat4, Vec3};
use std::collections::HashMap;

/// A scene in the making, as readers of its parts see it.
pub(super) struct Context<'a> {
    pub name: String,
    pub fetch: Fetch<'a>,
    pub files: Vec<String>,
    pub description: Description,
    /// World from what follows, at the opening and the closing of the shutter.
    pub place: [DMat4; 2],
    /// When the first and the second of two transforms hold, s.
    pub times_s: [f64; 2],
    /// The camera looks along +z with x to the right: a world in which that is no turn of ours is mirrored.
    pub is_mirrored: bool,
    /// Measured materials by the names of their files.
    measured: HashMap<String, Scattering>,
    warned: Vec<String>,
}

impl<'a> Context<'a> {
    /// For the file `name`, nothing read yet.
    pub fn new(name: &str, fetch: Fetch<'a>) -> Self {
        Context {
            name: name.to_owned(),
            fetch,
            files: vec![name.to_owned()],
            description: Description { name: name.to_owned(), ..Default::default() },
            place: [DMat4::IDENTITY; 2],
            times_s: [0.0, 1.0],
            is_mirrored: true,
            measured: HashMap::new(),
            warned: vec![],
        }
    }

    /// A fault with the name of its file.
    pub fn error(&self, fault: Fault) -> SceneError {
        let file = self.files.get(fault.place.file as usize).map_or(self.name.as_str(), String::as_str);
        let place = if fault.place.line == 0 { file.to_owned() } else { format!("{file}: line {}", fault.place.line) };
        SceneError::File { place, found: fault.found, expected: format!("expected {}", fault.expected) }
    }

    /// Says something once.
    pub fn warn(&mut self, place: Place, text: impl Into<String>) {
        let text = text.into();
        if !self.warned.contains(&text) {
            let file = &self.files[place.file as usize];
            self.description.warnings.push(format!("{file}: line {}: {text}", place.line));
            self.warned.push(text);
        }
    }

    /// Bytes of a file that the scene names; `.gz` is taken apart. Fails with the name and the reason where it cannot be had or is damaged.
    pub fn file(&self, name: &str, place: Place) -> Result<Vec<u8>, Fault> {
        fetched(self.fetch, name, place)
    }

    /// A picture that a texture names. Where it cannot be read that is noted: something stands in for it.
    pub fn picture(&mut self, name: &str) -> Option<Image> {
        let read = (self.fetch)(name).and_then(unzipped).and_then(|bytes| read_texture(&bytes));
        read.map_err(|reason| note_missing(&mut self.description.missing_textures, name, reason)).ok()
    }

    /// A measured material; where its file cannot be read that is noted, and something stands in for it.
    pub fn measured(&mut self, name: &str) -> Scattering {
        if let Some(known) = self.measured.get(name) {
            return known.clone();
        }
        let bytes = (self.fetch)(name).and_then(unzipped);
        let made = measured_or_stand_in(&mut self.description.missing_textures, name, bytes);
        self.measured.insert(name.to_owned(), made.clone());
        made
    }

    pub(super) fn say_unused(&mut self, p: &Params) {
        let unused: Vec<(Place, String)> =
            p.unused().map(|u| (u.place, format!("parameter \"{} {}\" is not used", u.kind, u.name))).collect();
        unused.into_iter().for_each(|(place, text)| self.warn(place, text));
    }

    pub(super) fn moves(&self) -> bool {
        self.place[0] != self.place[1]
    }

    /// The space that holds now from the world as it will be: mirrored if the camera's is of the other hand.
    pub fn texture_from_world(&self) -> Affine3A {
        let inverse = affine(self.place[0].inverse());
        if self.is_mirrored { inverse * flip() } else { inverse }
    }

    /// Where a medium is that is named now; `None` in a transform that nothing can be in.
    pub fn volume_place(&self, place: Place) -> Result<Option<VolumePlace>, Fault> {
        let [from, to] = self.place;
        Ok(match self.moves() {
            false => VolumePlace::still(affine(from)),
            true => VolumePlace::moving(self.times_s, [parts_of(from, place)?, parts_of(to, place)?]),
        })
    }
}

/// A file that another one names at a place, unpacked.
pub(super) fn fetched(fetch: Fetch, name: &str, place: Place) -> Result<Vec<u8>, Fault> {
    let told = |reason: String| place.fault(format!("{name}: {reason}"), "a file that can be read");
    unzipped(fetch(name).map_err(told)?).map_err(told)
}

/// Scale, turn and shift of a transform of something that moves.
pub(super) fn parts_of(m: DMat4, place: Place) -> Result<Parts, Fault> {
    let (scale, rotation, translation) = m.to_scale_rotation_translation();
    let again = DMat4::from_scale_rotation_translation(scale, rotation, translation);
    let off = (again - m).abs().to_cols_array().into_iter().fold(0.0, f64::max);
    let size = m.abs().to_cols_array().into_iter().fold(0.0, f64::max);
    if !(off <= 1e-4 * size) {
        return Err(place.fault("a sheared moving transform", "a transform of scales, turns and shifts"));
    }
    Ok(Parts { scale: scale.as_vec3(), rotation: rotation.as_quat(), translation: translation.as_vec3() })
}

pub(super) fn affine(m: DMat4) -> Affine3A {
    Affine3A::from_mat4(m.as_mat4())
}

pub(super) fn flip() -> Affine3A {
    Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0))
}
