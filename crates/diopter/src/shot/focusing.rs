//! What a shot is focused on: a distance, a place in the picture, a thing of the scene, or what autofocus finds.

use super::file::ShotFile;
use super::sections::{FocusSection, Zones};
use super::{Shot, ShotError, value};
use crate::camera::Camera;
use crate::depth_of_field::{CIRCLE_OF_DIAGONAL, hyperfocal_m};
use crate::expose::ProgressReporter;
use crate::focus::{self, Autofocus, Measure, Method, Motor, Priority, Report, View, autofocus};
use crate::metering;
use crate::quantity::FocusTo;
use diopter_lens::{Focus, LensError};
use diopter_light::units::Millimeters;
use diopter_scene::motion::Motion;
use diopter_scene::{Object, Scene};
use diopter_sensor::nearest;
use glam::Vec3;

/// Smallest side of a zone, a fraction of the picture.
const SMALLEST_ZONE: f64 = 0.004;
/// Most zones.
const MOST_ZONES: usize = 400;

/// Most positions of a sweep.
const MOST_SWEEP_STEPS: f64 = 100_000.0;

/// How a shot is focused.
#[derive(Clone, Debug)]
pub(super) struct Focusing {
    /// What on; `None` what the camera is aimed at.
    pub to: Option<FocusTo>,
    pub autofocus: Autofocus,
    pub require: bool,
}

impl Focusing {
    /// Checks what was asked; `diagonal_mm`: of the film. `warn` gets what was found odd. Fails on names that are not known, on zones, places, motors, sweeps and
    /// distances out of range, and on settings of autofocus without it.
    pub fn new(file: &ShotFile, diagonal_mm: f64, warn: &mut dyn FnMut(&str)) -> Result<Self, ShotError> {
        let f = &file.focus;
        let mut af = Autofocus::new(diagonal_mm);
        if let Some(name) = &f.method {
            let names = Method::NAMES.map(|n| n.0);
            af.method =
                named("focus method", name, Method::NAMES.iter().find(|n| n.0 == name.to_lowercase()).map(|n| n.1), &names)?;
        }
        if let Some(name) = &f.priority {
            af.priority = named("focus priority", name, Priority::named(name), &Priority::NAMES.map(|n| n.0))?;
        }
        if let Some(name) = &f.measure {
            let found = Measure::NAMES.iter().find(|n| n.0 == name.to_lowercase()).map(|n| n.1);
            af.measure = named("focus measure", name, found, &Measure::NAMES.map(|n| n.0))?;
        }
        if let Some(zones) = &f.zones {
            af.zones = match zones {
                Zones::Named(name) => named(
                    "focus zones",
                    name,
                    focus::zones_named(name),
                    &["one", "nine", "\"x,y,width,height\" (fractions of the picture)"],
                )?,
                Zones::Boxes(boxes) => boxes.clone(),
            };
            check_zones(&af.zones, warn)?;
        }
        if let Some(FocusTo::At([x, y])) = f.distance {
            if !(0.0..=1.0).contains(&x) || !(0.0..=1.0).contains(&y) {
                return Err(value("focus", format!("at {x},{y}"), "a place in the picture: 0 to 1 across and down"));
            }
            if f.zones.is_some() {
                return Err(value("focus zones", "beside a place", "either --focus at X,Y or zones, not both"));
            }
            af.zones = vec![focus::zone_at([x, y])];
        }
        if let Some([step_mm, backlash_mm, speed_mm_s]) = f.motor {
            if !([step_mm, backlash_mm, speed_mm_s].iter().all(|v| v.is_finite() && *v >= 0.0) && speed_mm_s > 0.0) {
                let found = format!("{step_mm},{backlash_mm},{speed_mm_s}");
                return Err(value("focus motor", found, "step (mm), backlash (mm) and speed (mm/s), the speed above 0"));
            }
            af.motor = Motor { step_mm, backlash_mm, speed_mm_s };
        }
        if let Some([from, to, step]) = f.sweep {
            let count = (to - from) / step;
            if !([from, to, step].iter().all(|v| v.is_finite()) && from < to && step > 0.0 && count <= MOST_SWEEP_STEPS) {
                let expected = format!("from, to and step in mm, the first below the second, at most {MOST_SWEEP_STEPS} steps");
                return Err(value("focus sweep", format!("{from},{to},{step}"), expected));
            }
            if f.method.is_some() && af.method != Method::Exhaustive {
                let found = f.method.clone().unwrap_or_default();
                return Err(value("focus method", found, "exhaustive, or nothing, beside a sweep, which looks at all positions"));
            }
            (af.method, af.sweep_mm) = (Method::Exhaustive, Some([from, to, step]));
        }
        let auto = matches!(f.distance, Some(FocusTo::Auto | FocusTo::At(_)));
        let of_auto = f.method.is_some()
            || f.priority.is_some()
            || f.measure.is_some()
            || f.zones.is_some()
            || f.motor.is_some()
            || f.sweep.is_some();
        if !auto && (of_auto || f.require) {
            return Err(value(
                "focus",
                shown(f),
                "auto (or at X,Y) beside zones, priority, method, measure, motor, sweep or require",
            ));
        }
        if let Some(FocusTo::Distance(d)) = &f.distance
            && !(d.0 > 0.0)
        {
            return Err(value("focus", d, "a distance above 0, such as 2.5m, or inf"));
        }
        Ok(Focusing { to: f.distance.clone(), autofocus: af, require: f.require })
    }

    /// What the lens is set to before anything is looked at; `subject_m`: how far away lies what the camera is aimed at, m.
    pub fn first(&self, subject_m: f64) -> Focus {
        match &self.to {
            Some(FocusTo::Distance(d)) => Focus::at_mm(1000.0 * d.0),
            Some(FocusTo::Extension(e)) => Focus::Extension(Millimeters(e.0)),
            Some(FocusTo::Auto | FocusTo::At(_) | FocusTo::Hyperfocal) => Focus::Infinity,
            Some(FocusTo::On(_)) | None => Focus::at_mm(1000.0 * subject_m),
        }
    }
}

fn shown(f: &FocusSection) -> String {
    f.distance.as_ref().map_or("on what the camera is aimed at".into(), |d| d.to_string())
}

fn named<T>(what: &'static str, name: &str, found: Option<T>, names: &[&str]) -> Result<T, ShotError> {
    found.ok_or_else(|| {
        let expected = match nearest(name, names.iter().copied()) {
            Some(near) => format!("one of {} (did you mean \"{near}\"?)", names.join(", ")),
            None => format!("one of {}", names.join(", ")),
        };
        value(what, format!("\"{name}\""), expected)
    })
}

fn check_zones(zones: &[[f64; 4]], warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
    if zones.is_empty() || zones.len() > MOST_ZONES {
        return Err(value("focus zones", zones.len(), format!("1 to {MOST_ZONES} zones")));
    }
    for [x, y, w, h] in zones {
        let found = format!("{x},{y},{w},{h}");
        if !(*w >= SMALLEST_ZONE && *h >= SMALLEST_ZONE) {
            let expected = format!("x,y,width,height with a width and a height above 0 (at least {SMALLEST_ZONE})");
            return Err(value("focus zone", found, expected));
        }
        if !(*x >= 0.0 && *y >= 0.0 && x + w <= 1.0 + 1e-9 && y + h <= 1.0 + 1e-9) {
            return Err(value(
                "focus zone",
                found,
                "x,y,width,height inside the picture, which goes from 0 to 1 across and down",
            ));
        }
    }
    let overlap = |a: &[f64; 4], b: &[f64; 4]| (0..2).all(|k| a[k] < b[k] + b[k + 2] && b[k] < a[k] + a[k + 2]);
    if zones.iter().enumerate().any(|(i, a)| zones[..i].iter().any(|b| overlap(a, b))) {
        warn("focus zones overlap: each is looked at by itself");
    }
    Ok(())
}

/// Distance along the camera's axis (m) of a thing by the name of its object or node: of its surface where it is seen in its middle, or of
/// its middle where something stands before it. As a focus puller's tape measures it, not as a camera sees it.
fn distance_of(scene: &Scene, camera: &Camera, name: &str, at_s: f64) -> Result<f64, ShotError> {
    let d = scene.description();
    // The nodes of that name and all that hangs on them.
    let below = |mut node: u32| {
        loop {
            let n = &d.nodes[node as usize];
            if n.name == name {
                return true;
            }
            match n.parent {
                Some(parent) => node = parent,
                None => return false,
            }
        }
    };
    let meant = |o: &Object| {
        o.name == name
            || match o.motion {
                Motion::Still => false,
                Motion::Carried { node } => below(node),
                Motion::Deformed { deformer } => below(d.deformers[deformer as usize].node),
            }
    };
    if !d.objects.iter().any(meant) {
        let mut names: Vec<&str> =
            d.objects.iter().map(|o| o.name.as_str()).chain(d.nodes.iter().map(|n| n.name.as_str())).collect();
        names.retain(|n| !n.is_empty());
        names.sort_unstable();
        names.dedup();
        let expected = match nearest(name, names.iter().copied()) {
            Some(near) => format!("an object of the scene (did you mean \"{near}\"?)"),
            None if names.len() <= 40 => format!("one of {}", names.join(", ")),
            None => format!("one of {} names, such as {}", names.len(), names[..8].join(", ")),
        };
        return Err(value("focus", format!("on {name}"), expected));
    }
    let bounds = d.bounds_at(at_s, meant);
    let place = camera.motion.at(0.0);
    let eye = Vec3::from(place.translation);
    let to = bounds.center() - eye;
    let ahead = -place.matrix3.z_axis.dot(to.into());
    if bounds.is_empty() || !ahead.is_finite() || ahead <= 0.0 {
        return Err(value("focus", format!("on {name}"), "something before the camera: it is behind it"));
    }
    let ray = diopter_light::Ray { origin: eye, direction: to.normalize(), time_s: 0.0 };
    let seen = scene.first_surface(&ray).filter(|s| d.objects.get(s.object as usize).is_some_and(meant));
    Ok(seen.map_or(ahead, |s| s.distance * camera.cosine_to_axis(ray.direction, 0.0)).into())
}

impl Shot {
    /// Focuses as asked: measures where a thing is, looks for what is sharp, sets the hyperfocal distance. Says what autofocus did; `None`
    /// where nothing was looked for. Must come before [`Shot::meter`]. Fails where the thing is not in the scene, where the lens cannot be focused so near, where
    /// autofocus finds nothing and must, and where it is cancelled.
    pub fn focus(&mut self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<Option<Report>, ShotError> {
        self.find_light_scale(watch)?;
        match &self.focusing.to {
            Some(FocusTo::Hyperfocal) => {
                self.focus_at(Focus::at_mm(1000.0 * self.hyperfocal_m()))?;
                self.facts.focus_mode = "hyperfocal".into();
                Ok(None)
            }
            Some(FocusTo::On(_)) => {
                self.follow(warn)?;
                Ok(None)
            }
            Some(FocusTo::Auto | FocusTo::At(_)) if self.lens_cap => {
                if self.focusing.require {
                    return Err(ShotError::Focus(focus::Failure::TooDark));
                }
                warn("autofocus sees nothing with the cap on the lens");
                Ok(None)
            }
            Some(FocusTo::Auto | FocusTo::At(_)) if self.camera.lens.is_sharp_everywhere() => {
                warn("a pinhole has no focus: all is equally sharp");
                Ok(None)
            }
            Some(FocusTo::Auto | FocusTo::At(_)) => self.autofocus(watch, warn).map(Some),
            _ => {
                self.facts.focus_mode = "manual".into();
                Ok(None)
            }
        }
    }

    fn circle_mm(&self) -> f64 {
        self.camera.film.width_mm.hypot(self.camera.film.height_mm) * CIRCLE_OF_DIAGONAL
    }

    fn hyperfocal_m(&self) -> f64 {
        hyperfocal_m(self.camera.lens.focal_length().0, self.camera.lens.f_number(), self.circle_mm())
    }

    fn autofocus(&mut self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<Report, ShotError> {
        let view = View {
            scene: &self.scene,
            camera: &self.camera,
            sensor: &self.sensor,
            reading: &self.reading,
            settings: &self.settings,
            filter: (-self.exposing.nd_stops).exp2(),
            watch,
        };
        let settings = Autofocus { deadline: self.focus_deadline(), ..self.focusing.autofocus.clone() };
        let report = autofocus(&view, &settings)?;
        let missed = report.zones.iter().filter(|zone| zone.failure == Some(focus::Failure::NoTime)).count();
        if missed > 0 {
            warn(&format!(
                "autofocus had no time for {missed} of {} zones: a third of the time limit is its own (fewer --focus-zones, a longer --time-limit, or a --focus distance)",
                report.zones.len()
            ));
        }
        if let Some(why) = report.failure() {
            if self.focusing.require {
                return Err(ShotError::Focus(why));
            }
            let place = report.distance_m.map_or("infinity".to_owned(), |d| format!("{d:.2} m (hyperfocal)"));
            warn(&format!("autofocus failed: {why}; the lens is set to {place}"));
        }
        self.focus_at(Focus::Extension(Millimeters(report.extension_mm)))?;
        let method = report.chosen.map_or("failed", |k| report.zones[k].method);
        self.facts.focus_mode = format!("auto ({method})");
        Ok(report)
    }

    /// Sets the lens on the thing that is followed, where it is now.
    pub(super) fn follow(&mut self, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let Some(FocusTo::On(name)) = self.focusing.to.clone() else { return Ok(()) };
        let distance = distance_of(&self.scene, &self.camera, &name, self.timing.at_s)?;
        if let Err(e) = self.focus_at(Focus::at_mm(1000.0 * distance)) {
            // In a film the thing may come too near; the first picture says so.
            if self.timing.at_s == self.begun_s() {
                return Err(e);
            }
            warn(&format!("{e}: the lens stays where it is"));
        }
        self.facts.focus_mode = format!("on {name}");
        Ok(())
    }

    /// Focuses elsewhere, with everything else as it is.
    fn focus_at(&mut self, focus: Focus) -> Result<(), ShotError> {
        self.camera.lens = self.camera.lens.refocused(focus)?;
        self.update_lens_facts();
        Ok(())
    }

    /// Moves the film back by so much, mm; not beyond infinity. `warn` is told where the lens does not go.
    pub(super) fn refocus_by(&mut self, mm: f64, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let to = self.camera.lens.extension().0 + mm;
        if to < -1e-9 {
            warn("the series ends at infinity: its last pictures are focused alike");
        }
        match self.focus_at(Focus::Extension(Millimeters(to.max(0.0)))) {
            Err(ShotError::Lens(LensError::Setting { .. } | LensError::Range { .. })) if mm > 0.0 => {
                warn("the lens focuses no nearer: the last pictures of the series are focused alike");
                Ok(())
            }
            other => other,
        }
    }

    /// Depth of focus at the film, 2 N c, mm.
    pub(super) fn depth_of_focus_mm(&self) -> f64 {
        2.0 * self.camera.lens.f_number() * self.circle_mm()
    }

    /// Scales the light of a scene that has no scale of its own.
    pub(super) fn find_light_scale(&mut self, watch: &ProgressReporter) -> Result<(), ShotError> {
        let Some(wanted) = self.ambient_ev.filter(|_| !self.lens_cap && !self.light_settled) else { return Ok(()) };
        let luminance = metering::mean_luminance(&self.scene, &self.camera, &self.settings, watch)?;
        if luminance > 0.0 && luminance.is_finite() {
            self.settings.light_scale = (wanted - metering::ev100_of_luminance(luminance)).exp2();
        }
        self.light_settled = true;
        Ok(())
    }
}
