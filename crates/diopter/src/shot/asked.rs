//! What a shot asks for, checked: what no file and no scene is needed for, and what the camera must be able to do once it stands.

use super::file::ShotFile;
use super::flag_values::{MOST_SAMPLES, alternatives};
use super::sections::{DiffractionChoice, RenderSection};
use super::{DEFAULT_BODY, DEFAULT_SEED, DEFAULT_SPP, Exposing, Inputs, ShotError, surroundings, value, white_point};
use crate::camera::Camera;
use crate::denoising::{Denoise, Filter};
use crate::expose::{Integrator, Response, Settings};
use crate::iso;
use crate::metering::Pattern;
use crate::program::Mode;
use crate::quantity::{FNumber, Seconds};
use crate::quick_look;
use crate::stray::{Stray, glare_unfit};
use diopter_image::ExposureFacts;
use diopter_image::channels::Channel;
use diopter_image::truth::Recorded;
use diopter_lens::Lens;
use diopter_light::random::SamplerKind;
use diopter_scene::PathSettings;
use diopter_sensor::{ColorSampling, Reading, Sensor};

/// A sheet whose pixels saturate at so many times its speed leaves a stop above middle grey, no highlights.
const MOST_OF_SPEED: f64 = 4.0;

/// A shot file, as far as nothing must be read for it but the body and the library that denoises.
pub(super) struct ShotRequest {
    pub settings: Settings,
    pub sensor: Sensor,
    pub exposing: Exposing,
    /// ISO speed to begin with.
    pub iso: f64,
    pub denoise: Denoise,
    pub filter: Option<Filter>,
}

impl ShotRequest {
    /// Checks a file whose engraved numbers have become what they stand for. Fails on a value out of its range, a name that is not known, and where the filter that is
    /// asked for cannot be used.
    pub fn new(file: &ShotFile, inputs: &Inputs, warn: &mut dyn FnMut(&str)) -> Result<ShotRequest, ShotError> {
        let mut settings = settings(&file.render)?;
        settings.polarizer = file.exposure.polarizer;
        let (sensor, exposing, iso) = body_and_speed(file, inputs)?;
        check_polarized(&settings, &sensor)?;
        white_point(white(file))?;
        if file.camera.color_sampling == Some(ColorSampling::Full) && !sensor.has_color_filters() {
            let found = format!("full, of {} with {}", sensor.name, sensor.cfa.channel_names().join(", "));
            return Err(value("color_sampling", found, "mosaic, or a body with red, green and blue filters"));
        }
        let e = &file.exposure;
        if let Some(Seconds(t)) = e.shutter
            && !(t > 0.0 && t <= 4e7)
        {
            return Err(value("shutter", Seconds(t), "a time above 0 (and of at most a year)"));
        }
        let celsius = e.temperature_c.unwrap_or(20.0);
        if !(-273.15..=200.0).contains(&celsius) {
            return Err(value("temperature", format!("{celsius} °C"), "-273 to 200 °C"));
        }
        if e.temperature_c.is_some()
            && let Some(ignored) = sensor.ignored_temperature()
        {
            warn(&ignored);
        }
        if let Some(FNumber(n)) = e.aperture
            && !FNumber::RANGE.contains(&n)
        {
            return Err(value("aperture", FNumber(n), FNumber::EXPECTED));
        }
        file.develop.check()?;
        // Without a word the front end says whether there are pictures to look at.
        let denoise = file.render.denoise.unwrap_or_default();
        let filter = match denoise {
            Denoise::Auto => None,
            asked => Filter::open(asked, file.render.oidn.as_deref(), warn)?,
        };
        if let Some(ev) = file.scene.ambient_ev
            && !(-30.0..=40.0).contains(&ev)
        {
            return Err(value("ambient_ev", ev, "-30 to 40"));
        }
        if e.shutter.is_some() && matches!(exposing.mode, Mode::AperturePriority | Mode::Program) {
            warn(&format!("in mode {} the camera chooses the time: the one given is not used", exposing.mode.name()));
        }
        if e.aperture.is_some() && matches!(exposing.mode, Mode::ShutterPriority | Mode::Program) {
            warn(&format!("in mode {} the camera chooses the aperture: the one given is not used", exposing.mode.name()));
        }
        if exposing.mode == Mode::Manual && exposing.auto_iso.is_none() && exposing.compensation_ev != 0.0 {
            warn(
                "in mode M with a set ISO speed nothing follows the meter: the compensation changes nothing; --iso auto lets the speed follow it",
            );
        }
        if e.metering_at.is_some() && exposing.pattern != Pattern::Spot {
            warn(&format!("metering {}: only the spot has a place, metering-at is not used", exposing.pattern.name()));
        }
        if e.slowest.is_some() && exposing.auto_iso.is_none() && exposing.mode != Mode::Program {
            warn("only automatic ISO and mode P keep to the slowest time: it is not used (--iso auto)");
        }
        warn_of_sheet(file, &sensor, iso, warn)?;
        surroundings::check(&file.scene)?;
        Ok(ShotRequest { settings, sensor, exposing, iso, denoise, filter })
    }

    /// Takes the body anew, where the scene's camera has hints for the film. Fails as [`ShotRequest::new`] does on the body.
    pub fn set_body(&mut self, file: &ShotFile, inputs: &Inputs) -> Result<(), ShotError> {
        (self.sensor, self.exposing, self.iso) = body_and_speed(file, inputs)?;
        Ok(())
    }

    /// How the sensor is read.
    pub fn reading(&self, file: &ShotFile) -> Reading {
        Reading {
            iso: self.iso,
            seed: self.settings.seed,
            serial: file.camera.serial.clone().unwrap_or_else(|| Reading::FIRST_SERIAL.into()),
            temperature_c: file.exposure.temperature_c,
            white: white(file).to_owned(),
            // Meter and autofocus read the mosaic; a picture: [`Shot::read_out`].
            color_sampling: ColorSampling::Mosaic,
        }
    }

    /// What is known before the light is metered, with what is known of the lens.
    pub fn facts(&self, scene: String, of_lens: ExposureFacts) -> ExposureFacts {
        ExposureFacts {
            software: concat!("diopter ", env!("CARGO_PKG_VERSION")).into(),
            scene,
            body: self.sensor.name.clone(),
            light_scale: 1.0,
            mode: self.exposing.mode.name().into(),
            // Where everything is set by hand nothing follows it.
            compensation_ev: match self.exposing.mode == Mode::Manual && self.exposing.auto_iso.is_none() {
                true => 0.0,
                false => self.exposing.compensation_ev,
            },
            nd_stops: self.exposing.nd_stops,
            polarizer: self.settings.polarizer.map_or(String::new(), |p| p.to_string()),
            ..of_lens
        }
    }
}

/// Refuses what is not followed with its polarisation.
fn check_polarized(settings: &Settings, sensor: &Sensor) -> Result<(), ShotError> {
    if !settings.is_polarized() && !Response::sensor(sensor).tells_polarization() {
        return Ok(());
    }
    if !matches!(settings.integrator, Integrator::Path | Integrator::PathReuse | Integrator::Auto) {
        return Err(value(
            "integrator",
            settings.integrator.name(),
            "path, path-reuse or auto where light is polarised: photons and light paths carry no polarisation",
        ));
    }
    if settings.records_direct() {
        return Err(value("truth-channels", "direct or indirect", "channels beside those two where light is polarised"));
    }
    Ok(())
}

/// Name of the illuminant that is white for the sensor.
fn white(file: &ShotFile) -> &str {
    file.exposure.white.as_deref().unwrap_or("D65")
}

/// Refuses what a camera, as it stands, cannot do of what is asked, and tells what it leaves out.
pub(super) fn check_camera(file: &ShotFile, camera: &Camera, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
    let (render, c) = (&file.render, &file.camera);
    let shaped =
        c.blades.is_some() || c.blade_curvature.is_some() || c.blade_rotation_deg.is_some() || c.aperture_image.is_some();
    if shaped && camera.lens.is_sharp_everywhere() {
        warn(
            "the shape of the iris shows nowhere: what is sharp everywhere has no aperture (--aperture gives fisheyes and calibrated cameras one)",
        );
    }
    let microlenses = camera.film.microlenses.is_some();
    if render.diffraction == Some(DiffractionChoice::On) {
        let expected = match &camera.lens {
            _ if microlenses => Some("auto or off with a microlens array: its lenses decide what is sharp"),
            Lens::Pinhole(_) => {
                Some("auto or off with a pinhole, which is sharp at any f-number (`calc pinhole` tells what a real one would be)")
            }
            _ if render.quick => Some("no quick look: its blur is made from depth alone"),
            _ => None,
        };
        if let Some(expected) = expected {
            return Err(value("diffraction", "on", expected));
        }
    }
    if file.camera.color_sampling == Some(ColorSampling::Full) && microlenses {
        return Err(value("color_sampling", "full", "mosaic behind a microlens array"));
    }
    if render.quick && microlenses {
        return Err(value("plenoptic", "a microlens array", "no quick look: it has no light field"));
    }
    if render.quick && camera.film.center_mm != [0.0; 2] {
        let found = match c.shift_mm {
            Some(_) => "a lens that is shifted",
            None => "the scene's camera, which sees beside its axis",
        };
        return Err(value("shift", found, "no quick look, or --shift 0: its blur is centred on the picture"));
    }
    if render.quick && quick_look::is_bent(camera) {
        warn("a quick look keeps straight lines straight: how this lens bends them is not shown");
    }
    if let Some(stray) = render.stray.as_deref().and_then(Stray::by_name).filter(|s| s.is_added()) {
        let none = match &camera.lens {
            Lens::Compound(_) if render.quick => Some("a quick look traces no rays through the lens"),
            Lens::Compound(_) if microlenses => Some("behind a microlens array it is not traced"),
            Lens::Compound(_) => None,
            _ => Some("an ideal lens has no surfaces; real ones are told by `lens list`"),
        };
        none.iter().for_each(|why| warn(&format!("there is no stray light in this picture: {why}")));
        if let (None, true, Lens::Compound(lens)) = (none, stray.scatter, &camera.lens)
            && let Some(why) = glare_unfit(lens)
        {
            warn(&format!("there is no scatter in this picture: {why}"));
        }
    }
    Ok(())
}

/// The body, how it is exposed, and its ISO speed to begin with.
fn body_and_speed(file: &ShotFile, inputs: &Inputs) -> Result<(Sensor, Exposing, f64), ShotError> {
    let sensor = inputs.body(file.camera.body.as_deref().unwrap_or(DEFAULT_BODY))?;
    let exposing = Exposing::new(file, &sensor)?;
    let iso = match exposing.auto_iso {
        Some([lowest, _]) => lowest,
        None => sensor.resolve_iso(file.exposure.iso.and_then(|choice| choice.fixed()), 0.0),
    };
    sensor.at_iso(iso)?;
    Ok((sensor, exposing, iso))
}

/// Says what is odd about the sheet of a body that is read from a file.
fn warn_of_sheet(file: &ShotFile, sensor: &Sensor, iso: f64, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
    let Some(path) = file.camera.body.as_ref().filter(|name| name.ends_with(".toml")) else { return Ok(()) };
    let embedded = Sensor::names().filter_map(|name| Sensor::named(name).ok()).find(|embedded| embedded.name == sensor.name);
    if embedded.is_some_and(|embedded| embedded != *sensor) {
        warn(&format!(
            "{path}: name \"{}\" is that of an embedded body, whose sheet counts wherever a file names it (a plane that is read out without --body): \
             expected a name of its own",
            sensor.name
        ));
    }
    let speed = iso::saturation_speed(sensor, iso)?;
    if speed > MOST_OF_SPEED * iso {
        warn(&format!(
            "{path}: at ISO {iso:.0} pixels saturate as at ISO {speed:.0} (quantum efficiency, full well and gain; `body iso` measures it): pictures that \
             the meter exposes will be clipped; expected settings whose speeds are near those"
        ));
    }
    Ok(())
}

/// Whether light is diffracted: as `diffraction` says; without, where stray light was chosen, only if diffraction is among its words.
pub(super) fn diffraction(render: &RenderSection) -> DiffractionChoice {
    let chosen = render.stray.as_deref().and_then(Stray::by_name);
    let of_stray = chosen.filter(|stray| !stray.diffraction).map(|_| DiffractionChoice::Off);
    render.diffraction.or(of_stray).unwrap_or_default()
}

fn settings(r: &RenderSection) -> Result<Settings, ShotError> {
    let spp = r.spp.unwrap_or(DEFAULT_SPP);
    if !(1..=MOST_SAMPLES).contains(&spp) {
        return Err(value("spp", spp, format!("1 to {MOST_SAMPLES} samples a pixel")));
    }
    let samples = r.samples.map_or(0..spp, |[a, b]| a..b);
    if samples.is_empty() || samples.end > spp {
        return Err(value(
            "samples",
            format!("{}..{}", samples.start, samples.end),
            format!("a range A..B with A < B <= spp ({spp})"),
        ));
    }
    let sampler = match r.sampler.as_deref() {
        None | Some("sobol") => SamplerKind::Sobol,
        Some("jittered") => SamplerKind::Jittered,
        Some("grid") => SamplerKind::Grid,
        Some("independent") => SamplerKind::Independent,
        Some(other) => return Err(value("sampler", format!("\"{other}\""), "sobol, jittered, grid or independent")),
    };
    let integrator = match r.integrator.as_deref() {
        None => Integrator::default(),
        Some(name) => Integrator::by_name(name)
            .ok_or_else(|| value("integrator", format!("\"{name}\""), alternatives(&Integrator::NAMES)))?,
    };
    let stray = match r.stray.as_deref() {
        None => Stray::default(),
        Some(name) => Stray::by_name(name).ok_or_else(|| value("stray", format!("\"{name}\""), Stray::expected()))?,
    };
    let limit = r.time_limit.map(|s| s.0);
    if limit.is_some_and(|l| !(l > 0.0)) {
        return Err(value("time-limit", r.time_limit.map_or(String::new(), |l| l.to_string()), "a time above 0"));
    }
    // A time limit alone means: as many samples as fit.
    let spp = if limit.is_some() && r.spp.is_none() { 1 << 16 } else { spp };
    let samples = if r.samples.is_some() { samples } else { 0..spp };
    let channels = r.truth_channels.as_deref().unwrap_or_default();
    let channels = Channel::list(channels).map_err(|e| ShotError::Value {
        what: "truth-channels".into(),
        found: e.found,
        expected: e.expected,
    })?;
    if let Some(c) = channels.iter().find(|c| r.quick && c.needs_pupil) {
        let expected = "channels of chief rays beside a quick look, which follows no light through a pupil: position, distance, uv, flow ...";
        return Err(value("truth-channels", c.name, expected));
    }
    let default = PathSettings::default();
    Ok(Settings {
        samples,
        sampler,
        seed: r.seed.unwrap_or(DEFAULT_SEED),
        path: PathSettings { max_depth: r.max_depth.unwrap_or(default.max_depth), ..default },
        integrator,
        polarized: r.polarized,
        stray,
        time_limit_s: limit,
        truth_channels: Recorded::new(&channels).more().to_vec(),
        ..Settings::new(spp)
    })
}
