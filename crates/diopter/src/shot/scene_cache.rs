//! Scenes that were read and built, kept for the next shot of the same.

use super::scene_setup::{self, CameraPlacement, DicingRate};
use super::sections::SceneSection;
use super::{Inputs, ShotError, surroundings, timing};
use crate::flash::Flash;
use diopter_scene::bvh::Bounds;
use diopter_scene::{Description, Scene};
use glam::Affine3A;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

/// The scene of the last shot, as it was read and as it was built: the next shot of the same scene takes it without reading files or building
/// hierarchies, whatever else of the shot has changed (lens, exposure, focus, where the camera stands unless lamps or ground follow it).
///
/// A file is read again when its own size or time of change differ; what it refers to (textures) is not looked at. Pictures are the same with
/// and without.
#[derive(Debug, Default)]
pub struct SceneCache {
    read: Option<(ReadKey, Kept<Arc<Description>>)>,
    built: Option<(BuiltKey, Kept<Scene>)>,
    /// Lamps and ground stay where the first camera had them put.
    of_rig: bool,
}

/// A value and the warnings that came with it, which each shot gets.
#[derive(Debug)]
struct Kept<T> {
    value: T,
    warnings: Vec<String>,
}

/// What a description depends on.
#[derive(Debug)]
struct ReadKey {
    name: String,
    scale: Option<f64>,
    strict: bool,
    /// Of a description in memory: held, so that no other can have its address.
    memory: Option<Arc<Description>>,
    stamp: Stamp,
}

impl PartialEq for ReadKey {
    fn eq(&self, other: &Self) -> bool {
        let same_memory = match (&self.memory, &other.memory) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        same_memory && (&self.name, self.scale, self.strict, self.stamp) == (&other.name, other.scale, other.strict, other.stamp)
    }
}

/// When a file was changed, and its bytes; `None` without a file.
type Stamp = Option<(SystemTime, u64)>;

fn stamp(path: &Path) -> Stamp {
    let data = std::fs::metadata(path).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// What a built scene depends on beside its description.
#[derive(Debug, PartialEq)]
pub(super) struct BuiltKey {
    section: SceneSection,
    flash: Option<Flash>,
    /// Whether the file that lights the scene is still the same.
    light: Stamp,
    /// Whether the table of classes is still the same.
    classes: Stamp,
    /// The moment, s, for which a ground is put under it.
    at_s: f64,
    /// Where the camera stands, where lamps or ground follow it.
    placement: Option<(Affine3A, [f32; 2], Bounds)>,
    /// How fine displaced surfaces are.
    dicing_rate: Option<DicingRate>,
}

impl BuiltKey {
    pub(super) fn new(
        d: &Description,
        section: &SceneSection,
        timing: &timing::Timing,
        placement: &CameraPlacement,
        dicing_rate: Option<DicingRate>,
    ) -> BuiltKey {
        let light = section.environment.as_deref().or(section.light.as_deref().map(Path::new)).and_then(stamp);
        let follows = surroundings::follow_camera(d, section, timing.flash.is_some());
        BuiltKey {
            section: section.clone(),
            flash: timing.flash,
            light,
            classes: section.classes.as_deref().and_then(stamp),
            at_s: timing.at_s,
            placement: follows.then_some((placement.place, placement.tan_half, placement.bounds)),
            dicing_rate: dicing_rate.filter(|_| !d.displaced.is_empty()),
        }
    }
}

impl SceneCache {
    /// Nothing yet.
    pub fn new() -> Self {
        SceneCache::default()
    }

    /// Nothing yet, for the cameras of a rig: what lamps and ground were put for is the first of them, wherever the others stand.
    pub(crate) fn of_rig() -> Self {
        SceneCache { of_rig: true, ..Default::default() }
    }

    /// The scene of a shot in its unit of length; see [`super::sources::read_scaled`].
    pub(super) fn description(
        &mut self,
        inputs: &mut Inputs,
        name: &str,
        section: &SceneSection,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Description, ShotError> {
        let (scale, strict, memory) = (section.scale, section.strict, inputs.scene.clone());
        let stamp = if memory.is_some() { None } else { stamp(Path::new(name)) };
        let key = ReadKey { name: name.to_owned(), scale, strict, memory, stamp };
        if self.read.as_ref().is_none_or(|(k, _)| *k != key) {
            // What is not wanted any more makes room first.
            (self.read, self.built) = (None, None);
            let mut warnings = Vec::new();
            let value = inputs.scene(name, scale, strict, &mut |text| warnings.push(text.to_owned()))?;
            self.read = Some((key, Kept { value: Arc::new(value), warnings }));
        }
        let (_, kept) = self.read.as_ref().expect("just read");
        kept.warnings.iter().for_each(|w| warn(w));
        Ok(Description::clone(&kept.value))
    }

    /// The scene built, with the surroundings, the ground and the flash that the shot asks for, and displaced surfaces as fine as it asks for. `description`: what [`SceneCache::description`]
    /// gave, played and with the materials chosen.
    pub(super) fn scene(
        &mut self,
        mut description: Description,
        section: &SceneSection,
        timing: &timing::Timing,
        placement: &CameraPlacement,
        dicing_rate: Option<DicingRate>,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Scene, ShotError> {
        let mut key = BuiltKey::new(&description, section, timing, placement, dicing_rate);
        if self.of_rig {
            (key.placement, key.dicing_rate) = (None, None);
        }
        if self.built.as_ref().is_none_or(|(k, _)| *k != key) {
            self.built = None;
            let mut warnings = Vec::new();
            let mut note = |text: &str| warnings.push(text.to_owned());
            if let Some((view, edge_px)) = dicing_rate {
                description.refine_displaced(&view, edge_px, timing.at_s);
            }
            if let Some(albedo) = surroundings::add(&mut description, section, timing.flash.is_some(), placement, &mut note)? {
                scene_setup::add_ground(&mut description, albedo, timing.at_s)?;
            }
            timing::add_flicker(&mut description, &section.flicker)?;
            if let Some(flash) = &timing.flash {
                flash.add_to_scene(&mut description);
            }
            let value = Scene::build(description)?;
            warnings.extend(value.description().warnings.iter().cloned());
            self.built = Some((key, Kept { value, warnings }));
        }
        let (_, kept) = self.built.as_ref().expect("just built");
        kept.warnings.iter().for_each(|w| warn(w));
        Ok(kept.value.clone())
    }
}
