//! Values in memory instead of names: what a program that calls this crate has at hand already.

use super::sources::{self, read_body, read_lens};
use super::{ShotError, ShotFile};
use crate::rig::path::Mounted;
use diopter_lens::Prescription;
use diopter_scene::Description;
use diopter_sensor::Sensor;
use std::sync::Arc;

/// What stands in for the scene, the lens and the body that a shot file names. `None`: as named there, or the default.
///
/// Everything else of the shot file counts as ever, such as the focal length of a zoom lens or the format of the film. The scene's own name says
/// whether it is an embedded one (with its framing) or a model file (which gets light where it has none).
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    /// The scene, m.
    pub scene: Option<Arc<Description>>,
    /// A lens with surfaces.
    pub lens: Option<Prescription>,
    /// The body.
    pub sensor: Option<Sensor>,
    /// How the camera goes along with a rig; where it stands by the shot file then says only what it is aimed at.
    pub mounted: Option<Arc<Mounted>>,
    /// The lens is set many times a second: its pupil is found at fewer places ([`diopter_lens::pupil::PupilDetail::Draft`]), and its profile is computed only where the
    /// development corrects by it.
    pub draft: bool,
}

impl Inputs {
    /// Writes the names of what is in memory into a shot file, where messages and facts look for them.
    pub(super) fn name_in(&self, file: &mut ShotFile) {
        if let Some(scene) = &self.scene {
            file.scene.file = Some(scene.name.clone());
        }
        if let Some(lens) = &self.lens {
            // No name of an ideal lens, whatever the prescription calls itself.
            let ideal = sources::IDEAL.contains(&lens.name.as_str());
            file.camera.lens = Some(if ideal { format!("\"{}\"", lens.name) } else { lens.name.clone() });
        }
        if let Some(sensor) = &self.sensor {
            file.camera.body = Some(sensor.name.clone());
        }
    }

    /// The scene in its unit of length; see [`sources::read_scaled`].
    pub(super) fn scene(
        &mut self,
        name: &str,
        scale: Option<f64>,
        strict: bool,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Description, ShotError> {
        match self.scene.take() {
            None => sources::read_scaled(name, scale, strict, warn),
            Some(shared) => {
                let mut description = Arc::unwrap_or_clone(shared);
                match scale {
                    Some(factor) => sources::rescale(&mut description, factor)?,
                    None => sources::odd_size(name, &description).iter().for_each(|hint| warn(hint)),
                }
                Ok(description)
            }
        }
    }

    /// A lens with surfaces.
    pub(super) fn lens(&self, name: &str) -> Result<Prescription, ShotError> {
        self.lens.clone().map_or_else(|| read_lens(name), Ok)
    }

    /// The body.
    pub(super) fn body(&self, name: &str) -> Result<Sensor, ShotError> {
        self.sensor.clone().map_or_else(|| read_body(name), Ok)
    }
}
