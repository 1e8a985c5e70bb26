//! Why a place of a picture is soft, bright and noisy, and what would change it: the camera's model asked again with one cause after the other left out.
//!
//! *Soft*: the image of the scene point that the chief ray of the place meets (`spot`) has a blur radius ([`Blur`]). The fraction of a cause is
//! 1 − (radius without it)² / (radius)². Fractions of independent causes add up to about one: exactly for Gaussian blurs; others miss by how their shapes differ, and
//! causes that cancel each other (a camera that follows its subject, defocus against spherical aberration) have fractions below zero. What is left out:
//!
//! - defocus: the lens focused on the point; what is still unsharp there is aberration, curvature of field or tilt
//! - aberrations: a thin lens of the same focal length, f-number, iris and focus, which has no mechanical vignetting either
//! - diffraction: no pattern of the aperture. Where the picture has none ([`Shot::diffracts`]) it has no fraction
//! - subject, camera: stands still where it is halfway through the time of the pixel
//! - pixel aperture, low-pass filter, crosstalk: pixels without extent, a filter that doubles nothing, neighbours that get nothing
//! - demosaicing, noise reduction: `development`
//!
//! *Bright* and *noisy*: `light`. *What to change*: all of this again with other settings; ISO speed makes up for light as far as the body allows.
//!
//! Left out: light scattered in the scene before the point (glass and mirrors are taken for the thing seen, and said so), stray light, sharpening, resizing,
//! and when a flash burns within the time. Source of the product of responses: G. D. Boreman, *Modulation Transfer Function in Optical and Electro-Optical Systems*
//! (SPIE 2001).

mod blur;
mod development;
mod light;
pub(crate) mod spot;

pub use blur::Blur;
pub use light::{Brightness, Factor, Noise, NoiseTerm};

use crate::camera::Camera;
use crate::camera_motion::CameraMotion;
use crate::focus::Report;
use crate::metering::ev100_of_facts;
use crate::shot::{Shot, ShotError, value};
use crate::shutter::Shutter;
use crate::stops::time_name;
use blur::{Filters, blur};
use diopter_develop::Step;
use diopter_image::{Cfa, ExposureFacts};
use diopter_lens::{Diffraction, Focus, Iris, Lens, ThinLens};
use diopter_light::units::Millimeters;
use diopter_scene::Scene;
use diopter_sensor::{ColorSampling, Reading};
use glam::DVec2;
use light::{Pixel, Seen};
use serde::Serialize;
use spot::{Colors, Moving, Spot, Subject, spot};

/// What softens a place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cause {
    /// What it is.
    pub name: &'static str,
    /// 1 − (radius without it)² / (radius)²; below 0 where it cancels another.
    pub fraction: f64,
    /// Blur radius that it adds in squares, µm on the film; negative where it takes some away.
    pub radius_um: f64,
    /// The same in pixels of the picture.
    pub radius_px: f64,
    /// The blur without it.
    pub without: Blur,
    /// Why it has no fraction, where there is more to say than a number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// What would change something.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// What is to be done.
    pub change: String,
    /// Blur radius then over that of now.
    pub blur: f64,
    /// Noise over signal then over that of now; not a number (null) where the pixel is full now or then: what is cut off is no noise.
    pub noise: f64,
    /// How much brighter the raw image gets, EV: 0 where ISO speed makes up for all of the light.
    pub brightness_ev: f64,
    /// ISO speed then.
    pub iso: f64,
}

/// What a place of a picture shows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shown {
    /// Name of the object; `None` where nothing is met.
    pub object: Option<String>,
    /// Distance along the chief ray, m.
    pub distance_m: Option<f64>,
    /// Distance at which the lens would be focused on it, m; `None` for infinity.
    pub depth_m: Option<f64>,
}

/// Why a place of a picture is as it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Why {
    /// The place, 0 to 1 across and down the picture.
    pub at: [f64; 2],
    /// Column and row of its pixel.
    pub pixel: [usize; 2],
    /// Columns and rows of the picture.
    pub size: [usize; 2],
    /// Distance of its pixels, µm.
    pub pitch_um: f64,
    /// What is seen there.
    pub shown: Shown,
    /// How the picture is taken.
    pub facts: ExposureFacts,
    /// The blur, all causes together.
    pub blur: Blur,
    /// What softens it.
    pub causes: Vec<Cause>,
    /// What makes it as bright as it is.
    pub brightness: Brightness,
    /// What its noise consists of.
    pub noise: Noise,
    /// What would change it.
    pub advice: Vec<Advice>,
    /// What these numbers leave out here.
    pub notes: Vec<String>,
}

/// Distance from which the diffraction of [`diopter_lens::Diffraction`] counts as wings, pixels; here all of it is one pattern.
const CORE_PX: f64 = 3.0;

/// The model of a camera before a scene.
struct Model<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    shutter: Shutter,
    colors: Colors,
    /// Fraction of a pixel's charge that each neighbour gets.
    crosstalk: f64,
    /// Whether light is diffracted behind a lens.
    diffracts: &'a dyn Fn(&Lens) -> bool,
}

/// What is switched on.
#[derive(Clone, Copy)]
struct On {
    moving: Moving,
    diffraction: bool,
    filters: Filters,
}

impl Model<'_> {
    /// Another lens, everything else as it is.
    fn with_lens(&self, lens: Lens) -> Camera {
        Camera { lens, ..self.camera.clone() }
    }

    /// The image of the point; `None` where the lens does not show it.
    fn spot(&self, subject: &Subject, camera: &Camera, shutter: &Shutter, on: &On) -> Option<Spot> {
        let film = &camera.film;
        let core_mm = CORE_PX * film.width_mm / film.columns.max(1) as f64;
        let diffracted = on.diffraction && (self.diffracts)(&camera.lens);
        let diffraction = if diffracted { Diffraction::new(&camera.lens, film.reach(), core_mm) } else { None };
        spot(subject, camera, shutter, on.moving, diffraction.as_ref(), &self.colors)
    }

    fn blur(&self, subject: &Subject, camera: &Camera, shutter: &Shutter, on: &On) -> Option<Blur> {
        Some(blur(&self.spot(subject, camera, shutter, on)?, &on.filters))
    }

    /// The camera focused on the point; says why where the lens cannot.
    fn focused(&self, subject: &Subject) -> Result<Camera, String> {
        let focus = subject.focus_mm(self.camera).map_or(Focus::Infinity, Focus::at_mm);
        self.camera
            .lens
            .refocused(focus)
            .map(|lens| self.with_lens(lens))
            .map_err(|e| format!("the lens does not focus there: {e}"))
    }

    /// The camera with an ideal lens in place of a real one; `None` where it has no aberrations.
    fn ideal(&self) -> Option<Camera> {
        let Lens::Compound(lens) = &self.camera.lens else { return None };
        let focus = match lens.focus_distance() {
            Some(Millimeters(mm)) => Focus::at_mm(mm),
            None if lens.extension().0 < 0.0 => Focus::Extension(lens.extension()),
            None => Focus::Infinity,
        };
        let iris: Iris = lens.system().iris.shape.clone();
        let thin = ThinLens::new(lens.focal_length(), lens.f_number(), iris, focus).ok()?.tilted(lens.tilt()).ok()?;
        Some(self.with_lens(Lens::Thin(thin)))
    }

    /// What softens a place, given the blur of all.
    fn causes(&self, subject: &Subject, all: &Blur, on: &On) -> Vec<Cause> {
        let spot = self.spot(subject, self.camera, &self.shutter, on);
        let still = |subject: bool, camera: bool| Moving { subject: !subject, camera: !camera };
        let moved = |moving: Moving| {
            // What does not move needs no second look.
            let same = moving == on.moving
                || (moving.camera && !self.scene.moves())
                || (moving.subject && self.camera.motion.is_still());
            if same { Some(*all) } else { self.blur(subject, self.camera, &self.shutter, &On { moving, ..*on }) }
        };
        let filtered = |filters: Filters| spot.as_ref().map(|spot| blur(spot, &filters));
        let f = on.filters;
        let sharp = self.camera.lens.is_sharp_everywhere();
        let defocus = match self.focused(subject) {
            _ if sharp => Ok(Some(*all)),
            Ok(camera) => Ok(self.blur(subject, &camera, &self.shutter, on)),
            Err(why) => Err(why),
        };
        let aberrations = self.ideal().map_or(Some(*all), |camera| self.blur(subject, &camera, &self.shutter, on));
        let diffraction = match on.diffraction && (self.diffracts)(&self.camera.lens) {
            true => Ok(self.blur(subject, self.camera, &self.shutter, &On { diffraction: false, ..*on })),
            false => Err("the picture has none".into()),
        };
        let [demosaicing, reduction] = f.development_px2;
        let list = [
            ("defocus", defocus),
            ("aberrations", Ok(aberrations)),
            ("diffraction", diffraction),
            ("motion of the subject", Ok(moved(still(true, false)))),
            ("motion of the camera", Ok(moved(still(false, true)))),
            ("pixel aperture", Ok(filtered(Filters { aperture_mm: [0.0; 2], ..f }))),
            ("low-pass filter", Ok(filtered(Filters { low_pass_mm: 0.0, ..f }))),
            ("crosstalk", Ok(filtered(Filters { crosstalk: 0.0, ..f }))),
            ("demosaicing", Ok(filtered(Filters { development_px2: [0.0, reduction], ..f }))),
            ("noise reduction", Ok(filtered(Filters { development_px2: [demosaicing, 0.0], ..f }))),
        ];
        list.into_iter().map(|(name, without)| cause(name, all, without)).collect()
    }
}

/// A cause, from the blur without it.
fn cause(name: &'static str, all: &Blur, without: Result<Option<Blur>, String>) -> Cause {
    let (without, note) = match without {
        Ok(Some(without)) => (without, None),
        Ok(None) => (*all, Some("the lens does not show the point then".to_owned())),
        Err(why) => (*all, Some(why)),
    };
    let added = |all: f64, without: f64| {
        let square = all * all - without * without;
        square.abs().sqrt().copysign(square)
    };
    let square = all.radius_um * all.radius_um;
    let fraction = if square > 0.0 { 1.0 - without.radius_um * without.radius_um / square } else { 0.0 };
    Cause {
        name,
        fraction,
        radius_um: added(all.radius_um, without.radius_um),
        radius_px: added(all.radius_px, without.radius_px),
        without,
        note,
    }
}

/// The place of a picture that is meant by default: where autofocus settled, else the middle.
fn usual_place(report: Option<&Report>) -> [f64; 2] {
    let zone = report.and_then(|r| r.chosen.and_then(|k| r.zones.get(k))).map(|found| found.zone);
    zone.map_or([0.5; 2], |[x, y, w, h]| [x + 0.5 * w, y + 0.5 * h])
}

/// Why a place (0 to 1 across and down) of the picture that a shot takes is as it is; without a place, where `report` says that it was focused, else in the middle.
/// The shot must have been focused and metered ([`Shot::focus`], [`Shot::meter`]). Fails on a place outside the picture or the image circle, with the cap on the lens,
/// and behind microlenses.
pub fn why(shot: &Shot, at: Option<[f64; 2]>, report: Option<&Report>) -> Result<Why, ShotError> {
    let film = &shot.camera.film;
    let size = [film.columns, film.rows];
    let at = at.unwrap_or_else(|| usual_place(report));
    if !at.iter().all(|v| (0.0..=1.0).contains(v)) {
        return Err(value("at", format!("{},{}", at[0], at[1]), "a place in the picture: 0 to 1 across and down"));
    }
    if shot.lens_cap {
        return Err(value("why", "a picture with the cap on the lens", "one that light reaches"));
    }
    if film.microlenses.is_some() {
        return Err(value(
            "why",
            "a light field",
            "a camera without microlenses: behind them every pixel sees through a part of the lens",
        ));
    }
    let shutter = shot.shutter();
    let place = DVec2::new(at[0] * size[0] as f64, at[1] * size[1] as f64);
    let Some(subject) = Subject::seen(&shot.scene, &shot.camera, &shutter, shot.at_s(), place) else {
        return Err(value(
            "at",
            format!("{},{}", at[0], at[1]),
            "a place that the lens shows: this one lies outside its image circle",
        ));
    };
    let white = light::white(shot)?;
    let response = strongest_response(shot, &white);
    let diffracts = |lens: &Lens| shot.diffracts_through(lens);
    let model = Model {
        scene: &shot.scene,
        camera: &shot.camera,
        shutter,
        colors: Colors::new(&response, &white),
        crosstalk: shot.sensor.crosstalk,
        diffracts: &diffracts,
    };

    // Light and noise.
    let (bands, luminance, variance) = light::exposed(shot, subject.pixel, shot.diffracts());
    let dark_s = light::dark_s(&shutter, subject.pixel, size);
    let pixel = Pixel { sensor: &shot.sensor, reading: &shot.reading, at: subject.pixel, bands: bands.clone(), dark_s };
    let noise = pixel.noise(variance)?;

    // Blur, first as far as the sensor: how soft the edges are that are developed.
    let on = |development_px2: [f64; 2]| On {
        moving: Moving { subject: true, camera: true },
        diffraction: true,
        filters: Filters::new(film, model.crosstalk, development_px2),
    };
    let Some(spot) = model.spot(&subject, &shot.camera, &shutter, &on([0.0; 2])) else {
        return Err(value("at", format!("{},{}", at[0], at[1]), "a place whose light the lens brings onto the film"));
    };
    let (mut header, per_electron) = pixel.header()?;
    if shot.color_sampling == ColorSampling::Full {
        header.cfa = Cfa::linear_rgb();
    }
    let level = pixel.electrons()? * per_electron;
    let sigma_px = blur(&spot, &on([0.0; 2]).filters).radius_px / std::f64::consts::SQRT_2;
    let on = on(development::added(&header, &shot.recipe, level, sigma_px)?);
    let all = blur(&spot, &on.filters);
    let causes = model.causes(&subject, &all, &on);
    let brightness = light::brightness(shot, &pixel, &Seen { subject: &subject, spot: &spot, luminance, bands: &bands })?;
    let now = Now {
        shot,
        model: &model,
        subject: &subject,
        on: &on,
        all: &all,
        pixel: &pixel,
        noise: &noise,
        variance,
        of_saturation: brightness.of_saturation,
    };
    let advice = now.advice(&causes)?;
    let description = shot.scene.description();
    let object = subject.surface.as_ref().and_then(|s| description.objects.get(s.object as usize));
    let name =
        |object: &diopter_scene::Object| if object.name.is_empty() { "(without a name)".to_owned() } else { object.name.clone() };
    Ok(Why {
        at,
        pixel: subject.pixel,
        size,
        pitch_um: 1e3 * film.width_mm / size[0] as f64,
        shown: Shown {
            object: object.map(name),
            distance_m: subject.surface.as_ref().map(|s| f64::from(s.t)),
            depth_m: subject.focus_mm(&shot.camera).map(|mm| 1e-3 * mm),
        },
        facts: shot.facts(),
        blur: all,
        causes,
        brightness,
        noise,
        advice,
        notes: notes(shot, &subject),
    })
}

/// The response of the channel that gets most of a light: what sharpness is judged by.
fn strongest_response(shot: &Shot, light: &diopter_light::spectrum::Table) -> diopter_light::spectrum::Table {
    let mut responses = shot.sensor.band_responses();
    let sum = |table: &diopter_light::spectrum::Table| -> f64 {
        (380..=780).step_by(5).map(|nm| f64::from(table.at(nm as f32)) * f64::from(light.at(nm as f32))).sum()
    };
    let best = (0..responses.len()).fold(0, |best, k| if sum(&responses[k]) > sum(&responses[best]) { k } else { best });
    responses.swap_remove(best)
}

/// What is left out at a place.
fn notes(shot: &Shot, subject: &Subject) -> Vec<String> {
    let mut notes = Vec::new();
    let mut note = |text: &str| notes.push(text.to_owned());
    if let Some(surface) = &subject.surface {
        let behind = shot.scene.first_rough_point(&subject.ray, shot.scene.immersion_at(subject.ray.origin));
        let apart = behind.map(|p| (p - surface.point).length());
        if apart.is_none_or(|d| d > 1e-3 * surface.t) {
            note("glass or a mirror is seen here: the blur is that of its surface, not of what is seen through it or in it");
        }
    }
    if shot.facts().flash {
        note("a flash burns for a part of the time: motion is counted as if light came all the time");
    }
    let recipe = &shot.recipe;
    if recipe.sharpen.amount > 0.0 {
        note("the development sharpens: that is not in the blur");
    }
    if recipe.resize != Default::default() {
        note("the development changes the size: pixels are those before");
    }
    if recipe.local != Default::default() || recipe.lens != Default::default() {
        note("local tone and corrections of the lens look at the whole picture: they are not in the brightness");
    }
    if recipe.white.patch.is_some() || recipe.white.balance.trim().eq_ignore_ascii_case("auto") {
        note("the white balance looks at the whole picture: that of the camera (as-shot) stands in for it in the brightness");
    }
    let whole = shot.sensor.cfa.is_monochrome() || shot.color_sampling == ColorSampling::Full;
    if !whole && recipe.demosaic.method == diopter_develop::Demosaic::Half {
        note(&format!("\"{}\" makes one pixel of each period of the filters: pixels are those before", Step::Demosaic.name()));
    }
    if !shot.diffracts() && !matches!(shot.camera.lens, Lens::Pinhole(_)) {
        note("diffraction does not show in pixels of this size, or is switched off: the picture has none (--diffraction on)");
    }
    notes
}

/// What changes are compared with.
struct Now<'a> {
    shot: &'a Shot,
    model: &'a Model<'a>,
    subject: &'a Subject<'a>,
    on: &'a On,
    all: &'a Blur,
    pixel: &'a Pixel<'a>,
    noise: &'a Noise,
    /// Of the pixel's electrons by the samples of the exposure, e⁻².
    variance: f64,
    /// Electrons over those that saturate the pixel.
    of_saturation: f64,
}

/// Causes that take a smaller fraction are not worth a change.
const WORTH_CHANGING: f64 = 0.02;
/// What happens to the ISO speed.
#[derive(Clone, Copy)]
enum Speed {
    Kept,
    /// It makes up for the light as far as the body allows.
    MakesUp,
    Of(f64),
}

/// From where on a picture is darker than its meter asks for, EV.
const DARK_EV: f64 = 0.7;
/// Most stops that are advised at once.
const MOST_STOPS: f64 = 8.0;

/// Smallest aperture that is advised.
const SMALLEST_STOP: f64 = 32.0;
/// Stops by which the aperture is tried.
const STOPS: [i32; 4] = [-2, -1, 1, 2];

/// "one stop", "two stops".
fn stops(n: i32) -> String {
    match n.abs() {
        1 => "one stop".into(),
        2 => "two stops".into(),
        n => format!("{n} stops"),
    }
}

impl Now<'_> {
    /// A change, its light over that of now. ISO speed makes up for it as far as the body allows.
    fn changed(
        &self,
        change: String,
        blur: Option<Blur>,
        light: f64,
        dark_s: f64,
        speed: Speed,
    ) -> Result<Option<Advice>, ShotError> {
        let (Some(blur), true) = (blur, light > 0.0) else { return Ok(None) };
        let sensor = self.pixel.sensor;
        let iso = match speed {
            Speed::Kept => self.pixel.reading.iso,
            Speed::MakesUp => sensor.nearest_iso(self.pixel.reading.iso / light),
            Speed::Of(iso) => iso,
        };
        let reading = Reading { iso, ..self.pixel.reading.clone() };
        let bands = self.pixel.bands.iter().map(|e| e * light).collect();
        let pixel = Pixel { sensor, reading: &reading, at: self.pixel.at, bands, dark_s };
        let noise = pixel.noise(self.variance * light * light)?;
        let brightness_ev = (light * iso / self.pixel.reading.iso).log2();
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 1.0 };
        let of_noise = match self.noise.clipped || noise.clipped {
            true => f64::NAN,
            false => ratio(self.noise.signal_to_noise, noise.signal_to_noise),
        };
        Ok(Some(Advice {
            change,
            blur: ratio(blur.radius_um, self.all.radius_um),
            noise: of_noise,
            // Nominal speeds are rounded.
            brightness_ev: if brightness_ev.abs() < 0.01 { 0.0 } else { brightness_ev },
            iso,
        }))
    }

    /// By how many stops the picture is darker than its meter asks for, or a full pixel holds more than it can.
    fn wrong_stops(&self) -> Option<f64> {
        if self.noise.clipped {
            // A little less than full.
            return Some(-self.of_saturation.max(1.0).log2().floor() - 1.0);
        }
        let f = self.shot.facts();
        let darker = ev100_of_facts(&f) - f.metered_ev100? + f.compensation_ev;
        (darker > DARK_EV).then(|| darker.round().clamp(1.0, MOST_STOPS))
    }

    fn advice(&self, causes: &[Cause]) -> Result<Vec<Advice>, ShotError> {
        let (model, subject, on) = (self.model, self.subject, self.on);
        let fraction = |name: &str| causes.iter().find(|c| c.name == name).map_or(0.0, |c| c.fraction);
        let mut advice = Vec::new();
        let lens = &model.camera.lens;
        let gathered = |camera: &Camera, shutter: &Shutter| light::gathered(subject, camera, shutter, &model.colors);
        let Some(light_now) = gathered(model.camera, &model.shutter) else { return Ok(advice) };
        let over_now = |light: Option<f64>| light.map_or(0.0, |l| l / light_now);
        let dark_s = self.pixel.dark_s;
        if !matches!(lens, Lens::Pinhole(_)) {
            for n in STOPS {
                let f_number = lens.f_number() * (0.5 * f64::from(n)).exp2();
                if f_number < 0.999 * lens.widest_f_number() || f_number > SMALLEST_STOP {
                    continue;
                }
                let Ok(stopped) = lens.stopped(f_number) else { continue };
                let camera = model.with_lens(stopped);
                let blur = model.blur(subject, &camera, &model.shutter, on);
                let way = if n > 0 { "down" } else { "open" };
                let change = format!("{} {way} (f/{f_number:.1})", stops(n));
                advice.extend(self.changed(change, blur, over_now(gathered(&camera, &model.shutter)), dark_s, Speed::MakesUp)?);
            }
        }
        if !lens.is_sharp_everywhere()
            && fraction("defocus") > WORTH_CHANGING
            && let Ok(camera) = model.focused(subject)
        {
            let distance = subject.focus_mm(model.camera).map_or("infinity".to_owned(), |mm| format!("{:.3} m", 1e-3 * mm));
            let blur = model.blur(subject, &camera, &model.shutter, on);
            advice.extend(self.changed(
                format!("focus here ({distance})"),
                blur,
                over_now(gathered(&camera, &model.shutter)),
                dark_s,
                Speed::Kept,
            )?);
        }
        let moves = fraction("motion of the subject").abs().max(fraction("motion of the camera").abs()) > WORTH_CHANGING;
        let timed = |factor: f64| Shutter { exposure_s: model.shutter.exposure_s * factor, ..model.shutter };
        let flash = self.shot.facts().flash;
        if moves && !flash {
            let shorter = timed(0.25);
            let blur = model.blur(subject, model.camera, &shorter, on);
            let change = format!("a quarter of the time ({})", time_name(shorter.exposure_s));
            advice.extend(self.changed(
                change,
                blur,
                over_now(gathered(model.camera, &shorter)),
                0.25 * dark_s,
                Speed::MakesUp,
            )?);
        }
        if fraction("motion of the camera") > WORTH_CHANGING {
            let camera = Camera { motion: CameraMotion::still(model.camera.motion.at(subject.time_s)), ..model.camera.clone() };
            let blur = model.blur(subject, &camera, &model.shutter, on);
            advice.extend(self.changed("a camera that stands still (a tripod)".into(), blur, 1.0, dark_s, Speed::Kept)?);
        }
        // Where nothing moves the time may be as long as the speed of the body allows.
        let lower = self.pixel.reading.iso / 4.0;
        if !model.scene.moves() && model.camera.motion.is_still() && !flash && self.pixel.sensor.at_iso(lower).is_ok() {
            let longer = timed(4.0);
            let change = format!("four times the time ({}) at ISO {lower:.0}", time_name(longer.exposure_s));
            let light = over_now(gathered(model.camera, &longer));
            advice.extend(self.changed(change, Some(*self.all), light, 4.0 * dark_s, Speed::MakesUp)?);
        }
        if let Some(stops) = self.wrong_stops().filter(|_| !flash) {
            let factor = stops.exp2();
            let other = timed(factor);
            let blur = model.blur(subject, model.camera, &other, on);
            let times =
                if factor > 1.0 { format!("{factor:.0} times the time") } else { format!("1/{:.0} of the time", 1.0 / factor) };
            let change = format!("{times} ({}) at the same speed", time_name(other.exposure_s));
            advice.extend(self.changed(change, blur, over_now(gathered(model.camera, &other)), factor * dark_s, Speed::Kept)?);
            let iso = self.pixel.sensor.nearest_iso(self.pixel.reading.iso * factor);
            if (iso / self.pixel.reading.iso).log2().abs() > 0.5 {
                let change = format!("a {} speed (ISO {iso:.0})", if factor > 1.0 { "higher" } else { "lower" });
                advice.extend(self.changed(change, Some(*self.all), 1.0, dark_s, Speed::Of(iso))?);
            }
        }
        let renderer = self.noise.terms.iter().find(|t| t.kind == "renderer").map_or(0.0, |t| t.fraction);
        if renderer > WORTH_CHANGING {
            let spp = self.shot.settings.spp.saturating_mul(4);
            let variance = light::variance(self.shot, self.pixel.at, self.shot.diffracts(), spp);
            let noise = self.pixel.noise(variance)?;
            let ratio = if noise.signal_to_noise > 0.0 { self.noise.signal_to_noise / noise.signal_to_noise } else { 1.0 };
            let change = format!("four times the samples (--spp {spp})");
            advice.push(Advice { change, blur: 1.0, noise: ratio, brightness_ev: 0.0, iso: self.pixel.reading.iso });
        }
        Ok(advice)
    }
}

#[cfg(test)]
mod tests;
