//! The lens of a shot, and the camera with it: chosen, set and focused, and what is said of it.

use super::super::file::ShotFile;
use super::super::focusing::Focusing;
use super::super::sections::CameraSection;
use super::super::sources::{ideal_fisheye, read_file};
use super::super::timing::Timing;
use super::super::{Inputs, ShotError, light_field, value};
use super::{CameraPlacement, STOPS, is_ideal, is_of_view, looks_through, nearest_in_the_middle, stop_for, subject_bounds, view};
use crate::calibration::camera_file::CameraSource;
use crate::camera::{Camera, Film};
use crate::camera_motion::CameraMotion;
use crate::moving_part::StabiliserPart;
use crate::quantity::{FocusTo, Hertz, LengthMm};
use crate::stabiliser::{DRIFT_HZ, SERVO_HZ, Stabiliser};
use diopter_lens::calibrated::{CalibratedLens, PixelGrid, Pupil, View};
use diopter_lens::camera_model::{CameraModel, ModelKind};
use diopter_lens::compound::{CompoundLens, Setting, printed_focal_length};
use diopter_lens::prescription::{Hood, Prescription};
use diopter_lens::pupil::PupilDetail;
use diopter_lens::{Focus, Iris, Lens, LensError, Pinhole, Projection, ThinLens, import};
use diopter_light::color::RgbSpace;
use diopter_light::units::Millimeters;
use diopter_scene::Scene;
use diopter_scene::load::read_codes;
use diopter_scene::scene::{CameraProjection, LensTable, Viewpoint};
use diopter_sensor::format::Format;
use diopter_sensor::{BodyLens, Sensor, format};
use glam::{DVec2, Vec3};

/// The iris that a shot asks for instead of the lens's own, which keeps what is not said of it. Fails on what no iris is, and on blades that are turned or rounded where
/// neither shot nor lens has any.
pub(super) fn iris(c: &CameraSection, own: &Iris) -> Result<Option<Iris>, ShotError> {
    let of_blades = c.blade_rotation_deg.map(|v| ("blade_rotation", format!("{v}°")));
    let of_blades = of_blades.or(c.blade_curvature.map(|v| ("blade_curvature", v.to_string())));
    if let Some(path) = &c.aperture_image {
        if let Some((what, found)) = c.blades.map(|n| ("blades", n.to_string())).or(of_blades) {
            return Err(value(what, found, "no aperture_image beside it: a picture has no blades"));
        }
        let told = |reason: String| ShotError::Read { path: path.display().to_string(), reason };
        let picture = read_codes(&read_file(path)?).map_err(told)?;
        let luminance = RgbSpace::Srgb.luminance_weights();
        let values =
            picture.data.as_chunks::<3>().0.iter().map(|p| (0..3).map(|c| luminance[c] * p[c]).sum::<f32>().min(1.0)).collect();
        return Ok(Some(Iris::image(picture.width, picture.height, values)?));
    }
    let (count, rotation, curvature) = match (c.blades, own, of_blades) {
        (Some(count), ..) => (count, 0.0, 0.0),
        (None, _, None) => return Ok(None),
        (None, Iris::Blades(b), _) => (b.count, b.rotation, b.curvature),
        (None, _, Some((what, found))) => {
            return Err(value(what, found, "blades beside it, such as blades = 7: the iris of this lens has none"));
        }
    };
    let rotation = c.blade_rotation_deg.map_or(rotation, f32::to_radians);
    Ok(Some(Iris::blades(count, rotation, c.blade_curvature.unwrap_or(curvature))?))
}

/// An ideal fisheye.
pub(super) fn fisheye(
    kind: ModelKind,
    name: &str,
    film: &Film,
    focal_mm: f64,
    f_number: f64,
    pupil: Option<Pupil>,
) -> Result<CalibratedLens, LensError> {
    let size = [film.columns, film.rows];
    let film_mm = [film.width_mm, film.height_mm];
    let per_mm = DVec2::new(size[0] as f64 / film_mm[0], size[1] as f64 / film_mm[1]);
    let centre = 0.5 * DVec2::new(size[0] as f64, size[1] as f64) - 0.5;
    let model = CameraModel::new(kind, per_mm * focal_mm, centre, Vec::new())?;
    let name = format!("{name} {focal_mm:.4} mm").replace(".0000", "");
    CalibratedLens::new(name, View::Model(model), PixelGrid { size, film_mm }, Millimeters(focal_mm), f_number, pupil, None)
}

/// What moves against the shake of a camera that stands; fails on what its lens does not have and on figures that no servo has.
pub(in crate::shot) fn stabiliser(file: &ShotFile, camera: &Camera, timing: &Timing) -> Result<Option<Stabiliser>, ShotError> {
    let Some(section) = &file.camera.stabiliser else { return Ok(None) };
    let moves = section.moves.as_deref().unwrap_or("lens");
    let part = || format!("\"{moves}\"");
    if !timing.shakes() {
        return Err(value("stabiliser", part(), "a camera that shakes (--shake 0.6; in a rig file: [rig] shake)"));
    }
    if file.render.quick || camera.film.microlenses.is_some() {
        return Err(value("stabiliser", part(), "no quick look and no microlenses: they know the lens with nothing moved"));
    }
    let part = match (moves, &camera.lens) {
        ("sensor", _) => StabiliserPart::Sensor,
        // Surfaces that were named are in the prescription, too ([`stabilised_group`]).
        (_, Lens::Compound(lens)) => match lens.prescription().stabiliser {
            Some(group) => StabiliserPart::Group(group),
            None => {
                let expected = "sensor, or the surfaces of a group, such as 15-17: the sheet of the lens names none (stabiliser = [first, last])";
                return Err(value("stabiliser", part(), expected));
            }
        },
        _ => return Err(value("stabiliser", part(), "sensor, or a real lens (--lens NAME)")),
    };
    let corner = |what: &'static str, given: Option<Hertz>, default: f64, least: f64| match given.map_or(default, |h| h.0) {
        f if f >= least && f <= 1e6 => Ok(f),
        f => Err(value(what, format!("{f} Hz"), if least > 0.0 { "0.1 Hz to 1 MHz" } else { "0 Hz to 1 MHz" })),
    };
    let servo_hz = corner("stabiliser servo", section.servo, SERVO_HZ, 0.1)?;
    let drift_hz = corner("stabiliser drift", section.drift, DRIFT_HZ, 0.0)?;
    let travel_mm = match section.travel {
        None => f64::INFINITY,
        Some(LengthMm(mm)) if mm > 0.0 && mm <= 1000.0 => mm,
        Some(travel) => return Err(value("stabiliser travel", format!("{} mm", travel.0), "above 0 to 1000 mm")),
    };
    let stabiliser = Stabiliser { part, servo_hz, drift_hz, travel_mm };
    // Whether the lens has such a group, and light passes it.
    stabiliser.during(camera, 0.0, |_| DVec2::ZERO)?;
    Ok(Some(stabiliser))
}

/// First and last surface (from 0) of the group that is asked to move against shake, where surfaces are named. Fails on what is neither that nor a word.
pub(super) fn stabilised_group(c: &CameraSection) -> Result<Option<[usize; 2]>, ShotError> {
    let Some(moves) = c.stabiliser.as_ref().and_then(|s| s.moves.as_deref()) else { return Ok(None) };
    if ["lens", "sensor"].contains(&moves) {
        return Ok(None);
    }
    let surfaces = moves.split_once('-').and_then(|(first, last)| {
        let [first, last] = [first, last].map(|n| n.trim().parse::<usize>().ok());
        Some([first?.checked_sub(1)?, last?.checked_sub(1)?])
    });
    let expected = "lens, sensor, or first and last surface of a group, such as 15-17";
    surfaces.map(Some).ok_or_else(|| value("stabiliser", format!("\"{moves}\""), expected))
}

/// Focal length (mm) that is asked of a real lens, by itself or by a printed zoom position. Fails on a position that is not printed.
pub(super) fn stated_focal_length(
    c: &CameraSection,
    prescription: &diopter_lens::prescription::Prescription,
) -> Result<Option<f64>, ShotError> {
    let printed = c.zoom_position.map(|position| printed_focal_length(prescription, position)).transpose()?;
    Ok(printed.or(c.focal_length.map(|f| f.0)))
}

/// The camera in its place.
pub(in crate::shot) fn camera(
    file: &ShotFile,
    inputs: &Inputs,
    scene: &Scene,
    at_s: f64,
    sensor: &Sensor,
    mut film: Film,
    focusing: &Focusing,
    placement: &CameraPlacement,
    warn: &mut dyn FnMut(&str),
) -> Result<Camera, ShotError> {
    let c = &file.camera;
    let view = view(file, scene.description())?;
    let ideal = is_ideal(c);
    let (focal_mm, own_f_number, framing) = (placement.focal_mm, placement.own_f_number, placement.framing);
    let mut place = placement.place;

    // How far along its axis the subject is.
    let subject_m = match (placement.framed, placement.subject_m) {
        // What is nearer than the focal length has no image.
        (Some(framed), _) => {
            nearest_in_the_middle(scene, placement).filter(|m| 1000.0 * m > 1.01 * placement.lens_mm).unwrap_or(framed.middle_m)
        }
        (None, Some(distance)) => distance,
        (None, None) => {
            let bounds = subject_bounds(scene, at_s);
            let (center, radius) = match bounds.is_empty() {
                true => (Vec3::ZERO, 1.0),
                false => (bounds.center(), (0.5 * bounds.size().length()).max(1e-3)),
            };
            let ahead = (center - Vec3::from(place.translation)).dot(place.transform_vector3(Vec3::NEG_Z));
            // A camera of the scene may stand within it.
            let seen =
                view.and_then(|_| nearest_in_the_middle(scene, placement)).filter(|m| 1000.0 * m > 1.01 * placement.lens_mm);
            seen.unwrap_or(f64::from(ahead.max(0.1 * radius)))
        }
    };
    if !place.is_finite() {
        return Err(value("viewpoint", "the scene's camera", "a place that is finite"));
    }

    let shifted = view.is_some_and(|v| v.film.shift != [0.0; 2]);
    if shifted && c.shift_mm.is_none() && looks_through(c) && !is_of_view(c) {
        warn("the scene's camera sees beside its axis, as a shifted lens does: this lens is not shifted (give --shift)");
    }
    // What the scene's own camera says of its lens counts where the shot says nothing.
    let bare = c.lens.is_none() && placement.calibrated.is_none() && c.orthographic.is_none();
    let own = view.and_then(|v| v.lens).filter(|_| bare && c.look_from.is_none());
    let of_view = own.filter(|[radius, _]| *radius > 0.0).map(|[radius, _]| focal_mm / (2000.0 * f64::from(radius)));
    let known = file.exposure.aperture.map(|a| a.0).or(of_view).or(own_f_number).or(framing.map(|f| f.f_number));
    let deep =
        placement.framed.filter(|_| c.plenoptic.is_none() && sensor.plenoptic.is_none() && c.lens.as_deref() != Some("pinhole"));
    let f_number = known.unwrap_or_else(|| match (deep, &focusing.to) {
        (Some(framed), Some(FocusTo::Distance(d))) => stop_for(placement.lens_mm, &film, d.0, framed.depths_m),
        (Some(framed), _) => stop_for(placement.lens_mm, &film, subject_m, framed.depths_m),
        (None, _) => STOPS[0],
    });
    let subject_m = own.filter(|[radius, _]| *radius > 0.0).map_or(subject_m, |[_, distance]| f64::from(distance));
    let focus = focusing.first(subject_m);
    let sharp = own.is_some_and(|[radius, _]| radius == 0.0) && file.exposure.aperture.is_none();
    let of_file = view.filter(|_| bare && c.look_from.is_none()).map(|v| &v.sight);
    // Without an aperture that somebody asked for, cameras that are projections see everything sharp.
    let blades = || iris(c, &Iris::Round).map(Option::unwrap_or_default);
    let asked = file.exposure.aperture.is_some();
    let calibrated = |source: &CameraSource| {
        let name = c.calibration.as_ref().map_or(String::new(), |p| p.display().to_string());
        Ok::<_, ShotError>(source.lens(
            &name,
            &film,
            f_number,
            asked.then(|| Ok::<_, ShotError>((blades()?, focus))).transpose()?,
        )?)
    };
    let hole =
        |projection| Ok::<_, LensError>(Lens::Pinhole(Pinhole { projection, ..Pinhole::new(Millimeters(focal_mm), f_number)? }));
    let panorama = Projection::Panorama { film_mm: [film.width_mm, film.height_mm] };
    let tilt = c.tilt_deg.unwrap_or([0.0; 2]).map(f64::to_radians);
    let lens = match c.lens.as_deref() {
        None if let Some(source) = &placement.calibrated => Lens::Calibrated(Box::new(calibrated(source)?)),
        _ if let Some(height) = c.orthographic => {
            if c.lens.as_deref().is_some_and(|l| l != "pinhole") || !(height.0 > 0.0 && height.0.is_finite()) {
                let found = format!("{} m high", height.0);
                return Err(value("orthographic", found, "a height above 0, without a lens: parallel rays have no aperture"));
            }
            hole(Projection::Orthographic { reduction: height.0 * 1000.0 / film.height_mm })?
        }
        Some(name) if let Some(kind) = ideal_fisheye(name) => {
            let pupil = asked.then(|| Ok::<_, ShotError>(Pupil { iris: blades()?, focus })).transpose()?;
            Lens::Calibrated(Box::new(fisheye(kind, name, &film, focal_mm, f_number, pupil)?))
        }
        None if let Some(CameraProjection::Table(table)) = of_file => {
            let (mut lens, behind_m) = lens_of_table(file, table, &film, focusing, warn)?;
            if tilt != [0.0; 2] {
                lens = lens.tilted(tilt)?;
            }
            // The file's camera stands where its film is.
            place.translation += place.matrix3 * glam::Vec3A::NEG_Z * behind_m as f32;
            Lens::Compound(Box::new(lens))
        }
        None if let Some(CameraProjection::Orthographic { height }) = of_file => {
            hole(Projection::Orthographic { reduction: f64::from(*height) * 1000.0 / film.height_mm })?
        }
        None if let Some(CameraProjection::Panorama) = of_file => hole(panorama)?,
        Some("panorama") => hole(panorama)?,
        None if sharp => Lens::Pinhole(Pinhole::new(Millimeters(focal_mm), f_number)?),
        Some("pinhole") => Lens::Pinhole(Pinhole::new(Millimeters(focal_mm), f_number)?),
        None | Some("thin") => {
            // The angle of view of a file is that of the picture, wherever its camera is focused.
            let focal = match focus {
                Focus::Distance(Millimeters(s)) if placement.is_of_view => focal_mm * s / (focal_mm + s),
                _ => focal_mm,
            };
            // So is the radius of its opening.
            let is_opening_of_view = file.exposure.aperture.is_none() && of_view.is_some();
            let f_number = if is_opening_of_view { f_number * focal / focal_mm } else { f_number };
            let thin = ThinLens::new(Millimeters(focal), f_number, blades()?, focus)?;
            Lens::Thin(thin.tilted(tilt)?)
        }
        Some(name) => {
            let prescription = inputs.lens(name)?;
            prescription.notes.iter().for_each(|n| warn(&format!("{name}: {n}")));
            let circle = prescription.image_circle;
            let printed = c.zoom_position.map(|position| printed_focal_length(&prescription, position)).transpose()?;
            let mut setting = Setting {
                focal_length: printed.or(c.focal_length.map(|f| f.0)),
                f_number: Some(f_number),
                focus,
                iris: iris(c, &prescription.iris)?,
                film_mm: (2.0 * film.reach()).to_array(),
            };
            let mut prescription = prescription;
            prescription.stabiliser = stabilised_group(c)?.or(prescription.stabiliser);
            let prescription = std::sync::Arc::new(hooded(prescription, c.hood, &setting)?);
            let detail = if inputs.draft { PupilDetail::Draft } else { PupilDetail::Full };
            let mut lens = CompoundLens::with_detail(prescription.clone(), &setting, detail);
            if file.exposure.aperture.is_none() && lens.is_err() {
                // Nobody asked for this aperture: as wide as the lens goes.
                setting.f_number = None;
                lens = CompoundLens::with_detail(prescription, &setting, detail);
            }
            let mut lens = lens?;
            if tilt != [0.0; 2] {
                lens = lens.tilted(tilt)?;
            }
            if let Some(asked) = file.exposure.aperture.filter(|a| lens.f_number() > a.0 * 1.005) {
                warn(&format!("{name}: fully open it is f/{:.2}, which is what f/{} stands for", lens.f_number(), asked.0));
            }
            let reached = lens.focal_length().0;
            let is_zoom = lens.prescription().zoom.len() > 1;
            if let Some(asked) = setting.focal_length.filter(|asked| is_zoom && (reached / asked - 1.0).abs() > 0.005) {
                warn(&format!("{name}: {asked} mm is beyond its end; it is set to {reached:.2} mm"));
            }
            let diagonal = 2.0 * film.reach().length();
            if let Some(circle) = circle.filter(|c| diagonal > 1.05 * c) {
                warn(&format!("{name} was made for pictures of {circle} mm across: the film ({diagonal:.1} mm) is larger"));
            }
            warn_of_dark_corners(name, &lens, &film, warn);
            Lens::Compound(Box::new(lens))
        }
    };
    if let Some(own) = sensor.lens.filter(|_| !ideal || c.focal_length.is_some()) {
        warn_of_long_lens(&lens, own, &film, warn);
    }
    if let Some(hood) = c.hood.filter(|_| !matches!(lens, Lens::Compound(_))) {
        return Err(value("hood", format!("{} mm", hood.0), "a real lens (--lens NAME): others have no front glass"));
    }
    if let Some([forward, right]) = c.tilt_deg.filter(|t| *t != [0.0; 2]) {
        let found = format!("{forward},{right} degrees");
        if !lens.is_tilted() {
            let expected = "a thin lens or one of glass (--lens thin or NAME): what is sharp everywhere has no plane of focus to turn, and a calibrated camera stays as it was measured";
            return Err(value("tilt", found, expected));
        }
        if c.plenoptic.is_some() || sensor.plenoptic.is_some() {
            return Err(value("tilt", found, "no microlenses behind a tilted lens"));
        }
        if file.render.quick {
            return Err(value("tilt", found, "no quick look: its blur knows no tilted plane"));
        }
    }
    film.microlenses = light_field::array(c.plenoptic.as_ref(), sensor, &film, lens.f_number())?;
    if film.microlenses.is_some() && matches!(lens, Lens::Pinhole(_) | Lens::Calibrated(_)) {
        return Err(value(
            "plenoptic",
            "a microlens array behind a pinhole or a calibration",
            "a lens with an aperture, such as thin: a hole has no views",
        ));
    }
    let other_angle = placement.calibrated.is_none() && (!ideal || c.focal_length.is_some());
    if let Some(view) = view.filter(|_| c.look_from.is_none() && c.path.is_empty() && other_angle) {
        warn_of_angle(view, &lens, &film, warn);
    }
    let camera = Camera { lens, film, motion: CameraMotion::still(place) };
    light_field::warn_of_pupils(&camera, warn);
    Ok(camera)
}

/// Diagonal of the smallest film that lenses for 35 mm are put on, mm: that of Four Thirds is 21.6 mm.
const SMALLEST_INTERCHANGEABLE_MM: f64 = 21.0;

/// From so many times the focal length of a body's own lens on another is said to be long.
const LONG_LENS: f64 = 3.0;

/// The focal length (mm) that is meant by default, by that on 36 × 24 mm: the same on films that take the same lenses, the one of
/// the same angle of view on smaller ones.
pub(super) fn usual_focal_length(on_full_frame_mm: f64, c: &CameraSection, sensor: &Sensor) -> f64 {
    let format = c.format.as_deref().and_then(Format::parse);
    let [width_mm, height_mm] = format.map_or(sensor.format_mm, |f| [f.width_mm, f.height_mm]);
    let diagonal = width_mm.hypot(height_mm);
    if diagonal < SMALLEST_INTERCHANGEABLE_MM {
        on_full_frame_mm * diagonal / format::FULL_FRAME_DIAGONAL_MM
    } else {
        on_full_frame_mm
    }
}

/// Says when a lens is very long for a body that has one of its own: 50 mm is a strong telephoto lens before the sensor of a phone.
pub(super) fn warn_of_long_lens(lens: &Lens, own: BodyLens, film: &Film, warn: &mut dyn FnMut(&str)) {
    let (focal, diagonal) = (lens.focal_length().0, film.width_mm.hypot(film.height_mm));
    let all_around = match lens {
        Lens::Pinhole(hole) => hole.projection != Projection::Rectilinear,
        Lens::Calibrated(_) => true,
        _ => false,
    };
    if focal > LONG_LENS * own.focal_length_mm && !all_around {
        warn(&format!(
            "{focal:.1} mm before a film of {diagonal:.1} mm across sees as narrow an angle as {:.0} mm on 36 × 24 mm; the body's own lens \
             is {} mm ({:.0} mm equivalent): leave --lens and --focal-length out for it",
            format::equivalent_35mm(focal, diagonal),
            own.focal_length_mm,
            format::equivalent_35mm(own.focal_length_mm, diagonal)
        ));
    }
}

/// Tangents of angles of view that differ by less than this factor are taken for the same.
const SAME_ANGLE: f64 = 1.1;

/// Says when the scene's camera sees much more or less than the lens that is used instead, and which embedded lens comes near.
pub(super) fn warn_of_angle(view: &Viewpoint, lens: &Lens, film: &Film, warn: &mut dyn FnMut(&str)) {
    let Some(fov) = view.vertical_fov() else { return };
    let wanted = (0.5 * f64::from(fov)).tan();
    let tangent = match lens.chief_ray(DVec2::Y * (0.5 * film.height_mm)) {
        Ok(ray) if ray.direction.z < 0.0 => ray.direction.truncate().length() / -ray.direction.z,
        _ => return,
    };
    if !(wanted > 0.0 && tangent > 0.0) || (wanted / tangent).ln().abs() < SAME_ANGLE.ln() {
        return;
    }
    let degrees = |tan: f64| 2.0 * tan.atan().to_degrees();
    let hint = match lens_of_angle(wanted, film) {
        Some((name, found)) if (found / wanted).ln().abs() < SAME_ANGLE.ln() => format!("; try --lens {name}"),
        Some((name, found)) => format!("; the nearest embedded lens is --lens {name} ({:.0}°)", degrees(found)),
        None => String::new(),
    };
    warn(&format!(
        "the scene's camera sees {:.0}° from top to bottom, this lens {:.0}°{hint}, or leave --lens and --focal-length out for the scene's angle",
        degrees(wanted),
        degrees(tangent)
    ));
}

/// Warns where no light reaches the corners of the film: a stated image circle says what a lens was sold for, the rims of its prescription
/// what it lights.
pub(super) fn warn_of_dark_corners(name: &str, lens: &CompoundLens, film: &Film, warn: &mut dyn FnMut(&str)) {
    let half = 0.5 * DVec2::new(film.width_mm, film.height_mm);
    let corner = half.length();
    let corners = [DVec2::ONE, DVec2::new(-1.0, 1.0), DVec2::NEG_ONE, DVec2::new(1.0, -1.0)];
    let count = if lens.system().is_rotational() { 1 } else { corners.len() };
    let lit = corners[..count].iter().map(|c| lens.image_circle_radius((half * *c).normalize(), corner)).fold(corner, f64::min);
    if lit > 0.995 * corner {
        return;
    }
    if let Some(glass) = lens.system().dark_glass() {
        let glass = glass.written();
        warn(&format!(
            "{name} lights nothing: its glass {glass} has no index in visible light (400 to 700 nm), which ends in it"
        ));
        return;
    }
    let remedy = format::FORMATS
        .iter()
        .filter(|f| 0.5 * f.diagonal_mm() <= lit)
        .max_by(|a, b| a.diagonal_mm().total_cmp(&b.diagonal_mm()));
    let remedy = remedy.map_or(String::new(), |f| {
        format!("; a smaller film is lit all over: --format \"{}\"", f.names[0].trim_end_matches('"'))
    });
    warn(&format!(
        "{name} lights the film to {lit:.1} mm from its middle, the corners are {corner:.1} mm away and stay dark: the rims of its prescription stop all light beyond{remedy}"
    ));
}

/// The embedded lens whose vertical angle of view on a film comes nearest to a tangent of half of it, as flags say it, and its own tangent. Of
/// lenses that cover the film; not fisheyes, whose pictures are others.
pub(super) fn lens_of_angle(tangent: f64, film: &Film) -> Option<(String, f64)> {
    let (half, diagonal) = (0.5 * film.height_mm, film.width_mm.hypot(film.height_mm));
    let wanted_mm = half / tangent;
    let off = |focal: f64| (focal / wanted_mm).ln().abs();
    let mut best: Option<(String, f64)> = None;
    for name in diopter_lens::embedded_names().filter(|n| !n.contains("fisheye")) {
        let Some(p) = diopter_lens::embedded(name) else { continue };
        if p.image_circle.is_none_or(|circle| circle < 0.99 * diagonal) {
            continue;
        }
        let ends = p.zoom.iter().copied().fold([f64::INFINITY, 0.0], |[a, b], f| [f.min(a), f.max(b)]);
        let (text, focal) = match p.focal_length {
            Some(focal) => (name.to_owned(), focal),
            None if ends[1] > 0.0 => {
                let focal = wanted_mm.clamp(ends[0], ends[1]);
                (format!("{name} --focal-length {focal:.0}mm"), focal)
            }
            None => continue,
        };
        // A zoom, which is asked for in two flags, only where it comes much nearer.
        let handicap = |text: &str| if text.contains(' ') { 0.5 * SAME_ANGLE.ln() } else { 0.0 };
        let better = best.as_ref().is_none_or(|(other, at)| off(focal) + handicap(&text) < off(half / at) + handicap(other));
        if better {
            best = Some((text, half / focal));
        }
    }
    best
}

/// A lens with the hood that was asked for, or its own, on.
pub(super) fn hooded(lens: Prescription, asked: Option<LengthMm>, setting: &Setting) -> Result<Prescription, ShotError> {
    let Some(hood) = asked.map(|length| Hood { length: length.0, diameter: None }).or(lens.hood) else { return Ok(lens) };
    if lens.object_axis.is_some() {
        let expected = "none: this lens has mirrors off the axis, and hoods stand on the axis of round lenses";
        return Err(value("hood", format!("{} mm", hood.length), expected));
    }
    hood.check().map_err(|_| value("hood", format!("{} mm", hood.length), "a length above 0 to 2000 mm"))?;
    let bare = std::sync::Arc::new(lens);
    // Fully open: what does not work without a hood is told by what comes next.
    let Ok(open) = CompoundLens::new(bare.clone(), &Setting { f_number: None, ..setting.clone() }) else {
        return Ok(std::sync::Arc::unwrap_or_clone(bare));
    };
    Ok(bare.with_hood(&hood, open.system(), 0.5 * DVec2::from_array(setting.film_mm)))
}

/// The lens of a scene file, and how far its film lies behind its entrance pupil, m.
pub(super) fn lens_of_table(
    file: &ShotFile,
    table: &LensTable,
    film: &Film,
    focusing: &Focusing,
    warn: &mut dyn FnMut(&str),
) -> Result<(CompoundLens, f64), ShotError> {
    let name = &table.file;
    let format = import::Format::of(name).unwrap_or(import::Format::PbrtDat);
    let mut prescription = import::read(&table.bytes, format, name).map_err(LensError::from)?;
    prescription.notes.iter().for_each(|n| warn(&format!("{name}: {n}")));
    if file.exposure.aperture.is_none()
        && let Some(stop) = prescription.surfaces.iter_mut().find(|s| s.stop)
    {
        // As wide as the file says, but no wider than the lens has it.
        let widest = stop.semi_diameter.unwrap_or(f64::INFINITY);
        if 0.5 * table.stop_mm > widest * 1.001 {
            warn(&format!(
                "{name}: an aperture of {} mm is wider than the lens's {:.2} mm: fully open",
                table.stop_mm,
                2.0 * widest
            ));
        }
        stop.semi_diameter = Some(widest.min(0.5 * table.stop_mm));
    }
    let prescription = std::sync::Arc::new(prescription);
    let focused = |focus: Focus| {
        let setting = Setting {
            focal_length: None,
            f_number: file.exposure.aperture.map(|a| a.0),
            focus,
            iris: iris(&file.camera, &prescription.iris)?,
            film_mm: (2.0 * film.reach()).to_array(),
        };
        Ok::<_, ShotError>(CompoundLens::new(prescription.clone(), &setting)?)
    };
    let behind = |lens: &CompoundLens| (lens.system().film_z - lens.first_order().entrance_pupil_z) * 1e-3;
    // Its distance counts from the film, which moves with it.
    let mut lens = focused(Focus::Infinity)?;
    for _ in 0..4 {
        let distance = table.focus_m - behind(&lens);
        if !(distance > 0.0) {
            let found = format!("{} m from the film", table.focus_m);
            return Err(value("focusdistance", found, format!("a plane before the lens, which is {:.3} m long", behind(&lens))));
        }
        lens = focused(focusing.first(distance))?;
    }
    let behind = behind(&lens);
    Ok((lens, behind))
}
