//! A flash on the camera: how bright, how long, when.
//!
//! The guide number (ISO 100, m) is f-number times distance of a right exposure. With the incident-light constant C = 250 of ISO 2720,
//! E t = C N² / S, so the light on the axis is I t = C GN² / S = 2.5 GN² cd·s. It leaves a white panel of the head's size, alike in all
//! directions (a bare head behind its diffuser; no zoom), as light of D65's colour. The pulse is even over its length.
//!
//! First curtain: fired as soon as the whole picture is open. Second curtain: so that it ends as the picture begins to close. When no
//! moment is open everywhere, it is fired when the last part opens, and what has closed by then stays dark: a band. High-speed sync:
//! the same energy stretched over the whole run of the shutter.

use crate::shutter::Shutter;
use diopter_light::Spectrum;
use diopter_scene::light::Modulation;
use diopter_scene::material::{Emission, EmissionColor, Material, Scattering};
use diopter_scene::motion::{Motion, Node};
use diopter_scene::shape::Mesh;
use diopter_scene::{Description, Object, Shape};
use glam::{Affine3A, Vec3};
use std::sync::Arc;

/// Incident-light constant, lx·s: ISO 2720, flat receptor; Sekonic.
pub const C: f64 = 250.0;
/// Size of the head, m: a common shoe-mounted unit's window.
const HEAD_M: [f32; 2] = [0.07, 0.04];
/// Where it sits from the lens when nothing else is said, m: above it, by the height of a shoe and a head; a little behind the pupil.
pub const SHOE_M: [f32; 3] = [0.0, 0.15, 0.03];

/// When it fires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sync {
    /// As soon as all is open.
    #[default]
    First,
    /// Just before the first part closes.
    Second,
    /// All the while.
    HighSpeed,
}

impl Sync {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Sync); 3] =
        [("first", Sync::First), ("second", Sync::Second), ("high-speed", Sync::HighSpeed)];

    /// The name's meaning; front and rear, HSS too. `None` of others.
    pub fn named(name: &str) -> Option<Sync> {
        match name.trim().to_lowercase().as_str() {
            "front" => Some(Sync::First),
            "rear" => Some(Sync::Second),
            "hss" => Some(Sync::HighSpeed),
            name => Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1),
        }
    }
}

/// A flash, set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flash {
    /// ISO 100, m.
    pub guide_number: f64,
    /// Fraction of full power.
    pub power: f64,
    /// s
    pub pulse_s: f64,
    /// When.
    pub sync: Sync,
    /// From the lens, m, along the camera's axes.
    pub offset_m: Vec3,
}

/// Material name and node name of a flash in a scene.
const NAME: &str = "flash";

impl Flash {
    /// When it burns, s since the exposure began, and whether all of the picture sees it.
    pub fn moment(&self, shutter: &Shutter) -> ((f64, f64), bool) {
        let total = shutter.total_s();
        let open = shutter.fully_open();
        match (self.sync, open) {
            (Sync::HighSpeed, _) => ((0.0, total), true),
            (Sync::First, Some((from, to))) => ((from, from + self.pulse_s), from + self.pulse_s <= to * (1.0 + 1e-9)),
            (Sync::Second, Some((from, to))) => {
                let start = (to - self.pulse_s).max(from);
                ((start, start + self.pulse_s), start + self.pulse_s <= to * (1.0 + 1e-9))
            }
            (_, None) => {
                // When the last part opens, at the latest so that the pulse falls within the run.
                let last = self.last_opening(shutter);
                ((last, last + self.pulse_s), false)
            }
        }
    }

    fn last_opening(&self, shutter: &Shutter) -> f64 {
        use crate::shutter::Mechanism;
        match shutter.mechanism {
            Mechanism::Global => 0.0,
            Mechanism::Leaf { .. } => (0.5 * (shutter.total_s() - self.pulse_s)).max(0.0),
            Mechanism::FocalPlane { travel_s, .. } => travel_s,
            Mechanism::Rolling { reset_s, .. } => reset_s,
        }
    }

    /// Its light before it fires: none at any moment.
    pub(crate) fn unfired(&self) -> Modulation {
        Modulation::Pulse { start_s: f64::NEG_INFINITY, length_s: self.pulse_s, energy: 1.0 }
    }

    /// Puts it into a scene that is not built yet: a panel on a free node, dark until [`Flash::moment`] is told.
    pub fn add_to_scene(&self, d: &mut Description) {
        let area = HEAD_M[0] * HEAD_M[1];
        // Luminance × time of a panel whose axis sends out 2.5 GN² cd·s.
        let candela_seconds = C / 100.0 * self.guide_number * self.guide_number * self.power;
        let radiance = Spectrum::light_from_rgb(Vec3::splat((candela_seconds / f64::from(area)) as f32));
        let emission = Emission {
            radiance: EmissionColor::Constant(radiance),
            two_sided: false,
            is_light: true,
            modulation: self.unfired(),
        };
        d.materials.push(Material { emission: Some(emission), ..Material::new(NAME, Scattering::Black) });
        d.nodes.push(Node { free: true, ..Node::new(NAME) });
        let (w, h) = (0.5 * HEAD_M[0], 0.5 * HEAD_M[1]);
        // Facing −Z.
        let corner = |x: f32, y: f32| self.offset_m + Vec3::new(x, y, 0.0);
        d.meshes.push(Arc::new(Mesh {
            positions: vec![corner(w, -h), corner(-w, -h), corner(-w, h), corner(w, h)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Default::default()
        }));
        let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
        let motion = Motion::Carried { node: d.nodes.len() as u32 - 1 };
        d.objects.push(Object { motion, ..Object::new(NAME, shape, d.materials.len() as u32 - 1) });
    }

    /// Numbers of its node and its material in a scene it was put into last.
    pub fn place_in(d: &Description) -> Option<(u32, u32)> {
        let node = d.nodes.iter().rposition(|n| n.free && n.name == NAME)?;
        let material = d.materials.iter().rposition(|m| m.name == NAME)?;
        Some((node as u32, material as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shutter::{Direction, Mechanism};

    #[test]
    fn it_fires_when_all_is_open_if_it_ever_is() {
        let flash = |sync| Flash { guide_number: 40.0, power: 1.0, pulse_s: 1e-3, sync, offset_m: Vec3::ZERO };
        let curtains =
            |exposure_s| Shutter { mechanism: Mechanism::FocalPlane { travel_s: 3e-3, direction: Direction::Down }, exposure_s };
        let slow = curtains(0.1);
        assert_eq!(flash(Sync::First).moment(&slow), ((3e-3, 4e-3), true));
        let ((a, b), all) = flash(Sync::Second).moment(&slow);
        assert!((a - 0.099).abs() < 1e-12 && (b - 0.1).abs() < 1e-12 && all);
        assert_eq!(flash(Sync::First).moment(&curtains(1e-3)), ((3e-3, 4e-3), false));
        assert_eq!(flash(Sync::HighSpeed).moment(&curtains(1e-3)), ((0.0, 4e-3), true));
    }
}
