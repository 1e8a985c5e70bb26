//! What a prepared shot comes to: the facts that pages are told, and what its exposure and its metering depend on.

use super::Engine;
use crate::pose::Pose;
use crate::series::changes_with_time;
use crate::session::{Asked, Found};
use diopter::depth_of_field::{CIRCLE_OF_DIAGONAL, hyperfocal_m, limits_m};
use diopter::image::ExposureFacts;
use diopter::lens::compound::{nearest_focus, printed_focal_lengths};
use diopter::lens::{Focus, Lens};
use diopter::metering::ev100_of_setting;
use diopter::shot::sections::{CameraSection, FlashSection, RenderSection, SceneSection, ShutterSection};
use diopter::shot::{Shot, ShotFile};
use glam::Vec3;
use serde_json::json;

/// What an exposure depends on, beside the time where everything stands still.
#[derive(Clone, PartialEq)]
pub(super) struct ExposureKey {
    pub facts: ExposureFacts,
    /// As placed: an extension says it to the last digit.
    pub focus: Option<f64>,
    pub scene: SceneSection,
    pub camera: CameraSection,
    pub shutter: ShutterSection,
    pub flash: Option<FlashSection>,
    pub render: RenderSection,
    pub lens_cap: bool,
    pub light_scale: f64,
}

/// What a reading of the meter depends on.
#[derive(Clone, PartialEq)]
pub(super) struct MeterKey {
    pub exposure: ExposureKey,
    pub metering: Option<String>,
    pub at: Option<[f64; 2]>,
}

impl Engine<'_> {
    /// What pages are told of a shot.
    pub(super) fn found(&self, asked: &Asked, full: [usize; 2], warnings: Vec<String>) -> Found {
        let Some(shot) = &self.shot else { return Found::default() };
        let facts = shot.facts();
        let film = &shot.camera.film;
        let circle_mm = film.width_mm.hypot(film.height_mm) * CIRCLE_OF_DIAGONAL;
        let place = shot.camera.motion.at(0.0);
        let (eye, ahead) = (Vec3::from(place.translation), -Vec3::from(place.matrix3.z_axis));
        let bounds = shot.subject_bounds();
        let center = if bounds.is_empty() { eye + ahead } else { bounds.center() };
        let distance = facts.focus_distance_m.filter(|d| d.is_finite()).map_or((center - eye).dot(ahead), |d| d as f32);
        let c = &asked.shot.camera;
        let target = match (c.look_from, c.look_at) {
            (Some(_), Some(at)) => Vec3::from_array(at),
            _ => eye + ahead * distance.max(1e-3),
        };
        let pose = Pose { eye, target, up: c.up.map_or(Vec3::Y, Vec3::from_array) };
        let mut settled = asked.shot.clone();
        shot.write_resolved(&mut settled);
        settled.render.size = asked.shot.render.size;
        settled.camera.path.clear();

        let limits = facts.focus_distance_m.map(|d| limits_m(facts.focal_length_mm, facts.f_number, circle_mm, d));
        let finite = |v: f64| v.is_finite().then_some(v);
        let mut told = ExposureFacts { lens_profile: None, light_field: None, ..facts.clone() };
        told.shutter = facts.shutter.clone();
        let (mut zoom, mut nearest_m) = (None, None);
        if let Lens::Compound(lens) = &shot.camera.lens {
            let p = lens.prescription();
            zoom = (!p.zoom.is_empty()).then(|| printed_focal_lengths(p));
            nearest_m = nearest_focus(p, lens.state().zoom).map(|mm| mm / 1000.0);
        }
        let ideal = matches!(shot.camera.lens, Lens::Thin(_) | Lens::Pinhole(_));
        let timeline = animation_span(shot);
        let setting = setting_ev100(shot);
        let told = json!({
            "exposure": told, "setting_ev100": setting,
            // What the meter says of the setting: above 0 the picture will be lighter than middle grey.
            "meter_ev": facts.metered_ev100.map(|ev| ev - setting),
            "widest": shot.camera.lens.widest_f_number(), "pinhole": shot.camera.lens.is_sharp_everywhere(),
            "zoom": zoom, "ideal": ideal, "nearest_m": nearest_m,
            "depth_of_field": limits.map(|(near, far)| json!({ "near_m": finite(near), "far_m": finite(far) })),
            "hyperfocal_m": hyperfocal_m(facts.focal_length_mm, facts.f_number, circle_mm), "circle_mm": circle_mm,
            "film_mm": [film.width_mm, film.height_mm], "size": full,
            "isos": shot.sensor.iso.iter().map(|s| s.iso).collect::<Vec<_>>(),
            "body": { "name": shot.sensor.name, "pixels": shot.sensor.pixels, "format_mm": shot.sensor.format_mm, "cfa": shot.sensor.cfa.letters() },
            "timeline": timeline, "moves": !stands_still(shot),
        });
        Found {
            facts: told,
            pose: Some(pose),
            tan_half_width: (0.5 * film.width_mm / facts.focal_length_mm.max(1e-3)) as f32,
            settled,
            focus: self.focus.clone(),
            warnings,
        }
    }
}

/// EV at ISO 100 of the setting as the meter counts it: by the T-stop and by what the shutter is worth.
pub(super) fn setting_ev100(shot: &Shot) -> f64 {
    let facts = shot.facts();
    let time = facts.shutter.as_ref().map_or(facts.exposure_s, |s| s.effective_s);
    ev100_of_setting(facts.t_number.max(1e-3), if time > 0.0 { time } else { facts.exposure_s.max(1e-12) }, facts.iso.max(1e-3))
}

/// First and last key of what the scene's animations do, s.
fn animation_span(shot: &Shot) -> Option<[f64; 2]> {
    let d = shot.scene.description();
    let spans = d.playing.animations.iter().filter_map(|i| d.animations.get(*i)).map(|a| a.span_s());
    let span = spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
    (span[1] > span[0]).then_some(span)
}

/// Whether the exposure of a shot is proportional to its time: neither scene nor camera nor light changes, and the shutter's blades take nothing.
pub(super) fn stands_still(shot: &Shot) -> bool {
    let leaf = shot.facts().shutter.is_some_and(|s| s.kind == "leaf");
    !changes_with_time(shot) && !leaf && shot.file().flash.is_none()
}

/// What the exposure of a shot depends on; `still`: its time is left out.
pub(super) fn exposure_key(shot: &Shot, file: &ShotFile, still: bool) -> ExposureKey {
    let mut facts = shot.facts().of_picture();
    // Known only behind the exposure or the read-out, or part of the file that is compared below.
    facts.shutter = None;
    facts.samples = 0;
    if still {
        facts.exposure_s = 0.0;
    }
    let mut scene = file.scene.clone();
    scene.ambient_ev = None;
    let focus = match &shot.camera.lens {
        Lens::Thin(lens) => match lens.focus {
            Focus::Distance(d) => Some(d.0),
            Focus::Extension(e) => Some(-e.0),
            Focus::Infinity => None,
        },
        _ => None,
    };
    ExposureKey {
        facts,
        focus,
        scene,
        camera: file.camera.clone(),
        shutter: file.shutter.clone(),
        flash: file.flash.clone(),
        render: RenderSection { size: file.render.size, spp: None, ..file.render.clone() },
        lens_cap: file.exposure.lens_cap,
        light_scale: shot.settings.light_scale,
    }
}
