//! Before the camera: the floor, the film, where the camera stands and what it is aimed at.

mod lens;

pub(super) use lens::{camera, stabiliser};

use super::file::ShotFile;
use super::framing::{self, Angle, Framed};
use super::sections::{CameraSection, SceneSection};
use super::sources::ideal_fisheye;
use super::{Inputs, LARGEST_SIDE, ShotError, value};
use crate::calibration::camera_file::{CameraFile, CameraSource};
use crate::calibration::read_camera;
use crate::camera::{Camera, Film, look_at};
use crate::camera_motion::CameraMotion;
use crate::depth_of_field::{CIRCLE_OF_DIAGONAL, circle_mm};
use crate::files;
use crate::metering;
use crate::quantity::{Iso, IsoChoice, LengthMm, Size};
use diopter_lens::Focus;
use diopter_lens::camera_model::ModelKind;
use diopter_lens::compound::{CompoundLens, Setting};
use diopter_light::Ray;
use diopter_light::units::shown;
use diopter_scene::bvh::Bounds;
use diopter_scene::classes::ClassTable;
use diopter_scene::load::PixelView;
use diopter_scene::material::{Interior, Material, Scattering, Transmission};
use diopter_scene::motion::Motion;
use diopter_scene::scene::{CameraProjection, FilmHints, Viewpoint};
use diopter_scene::shape::Quad;
use diopter_scene::studio::Studio;
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, Scene, Shape, builtin};
use diopter_sensor::format::{self, Format};
use diopter_sensor::{Sensor, nearest};
use glam::{Affine3A, DVec2, Vec3};
use lens::{stated_focal_length, usual_focal_length};
use std::ops::RangeInclusive;

const DEFAULT_WIDTH: usize = 960;

/// Name of the floor.
const GROUND: &str = "ground";

/// Adds a floor just below the lowest point of the meshes.
pub(super) fn add_ground(d: &mut Description, albedo: f32, at_s: f64) -> Result<(), ShotError> {
    if !(0.0..=1.0).contains(&albedo) {
        return Err(value("ground", albedo, "an albedo from 0 to 1"));
    }
    let bounds = d.bounds_at(at_s, |_| true);
    if bounds.is_empty() {
        return Err(value("ground", albedo, "a scene with something to stand on it"));
    }
    let size = bounds.size().max_element().max(1e-3);
    let reach = 200.0 * size;
    let corner = bounds.center().with_y(bounds.min.y - 1e-4 * size) + Vec3::new(-0.5, 0.0, 0.5) * reach;
    d.materials.push(Material::new(GROUND, Scattering::Diffuse(Color::rgb(albedo, albedo, albedo))));
    let shape = Shape::Quad(Quad { corner, edges: [Vec3::X * reach, Vec3::NEG_Z * reach] });
    d.objects.push(Object::new(GROUND, shape, d.materials.len() as u32 - 1));
    Ok(())
}

/// Whether an object was put into the scene for the photograph: a floor, parts of a studio.
fn is_staging(o: &Object) -> bool {
    (o.name == GROUND && matches!(o.shape, Shape::Quad(_))) || Studio::is_part(o)
}

/// The box around everything but what was put there for the photograph and a flash.
pub(super) fn subject_bounds(scene: &Scene, at_s: f64) -> Bounds {
    // Of captured places the core counts, without strays.
    let partly = |o: &Object| is_staging(o) || matches!(o.shape, Shape::Splats { .. });
    match scene.description().objects.iter().any(partly) {
        false => scene.bounds(),
        true => scene.description().bounds_at(at_s, |o| !is_staging(o)),
    }
}

/// The film; `view`: the scene's camera, which may ask for a size.
pub(super) fn film(file: &ShotFile, sensor: &Sensor, view: Option<&Viewpoint>) -> Result<Film, ShotError> {
    let wanted = view.and_then(|v| v.film.size);
    let [mut width_mm, mut height_mm] = sensor.format_mm;
    let own = view.filter(|v| matches!(v.sight, CameraProjection::Table(_)) && file.camera.lens.is_none());
    if let Some(diagonal) = own.and_then(|v| v.film.diagonal_mm) {
        // The scene's own film, in the shape of its picture.
        let [w, h] = wanted.map_or([width_mm, height_mm], |s| s.map(|n| n as f64));
        (width_mm, height_mm) = (diagonal * w / w.hypot(h), diagonal * h / w.hypot(h));
    }
    if let Some(name) = &file.camera.format {
        let named = Format::parse(name);
        let Some(f) = named else {
            let names: Vec<&str> = format::FORMATS.iter().map(|f| f.names[0]).collect();
            let expected = match nearest(name, names.iter().copied()) {
                Some(near) => format!("a format (did you mean \"{near}\"?)"),
                None => format!("one of {}, or width x height in mm such as 36x24", names.join(", ")),
            };
            return Err(value("format", format!("\"{name}\""), expected));
        };
        (width_mm, height_mm) = (f.width_mm, f.height_mm);
    }
    let wanted = wanted.map(|[width, height]| Size { width, height });
    let size = file.render.size.or(wanted).unwrap_or_else(|| Size {
        width: DEFAULT_WIDTH,
        height: (DEFAULT_WIDTH as f64 * height_mm / width_mm).round().max(1.0) as usize,
    });
    if size.width == 0 || size.height == 0 || size.width > LARGEST_SIDE || size.height > LARGEST_SIDE {
        return Err(value("size", size, format!("1 to {LARGEST_SIDE} pixels a side")));
    }
    // The picture keeps the format's width or height, whichever its shape uses fully.
    let shape = size.width as f64 / size.height as f64;
    let (w, h) = if shape > width_mm / height_mm { (width_mm, width_mm / shape) } else { (height_mm * shape, height_mm) };
    let [px, py] = sensor.pitch_mm();
    let gap = 1.0 - sensor.fill_factor.sqrt();
    Ok(Film {
        width_mm: w,
        height_mm: h,
        columns: size.width,
        rows: size.height,
        pixel_area_mm2: px * py,
        low_pass_mm: sensor.low_pass_px * px,
        gap_mm: [gap * px, gap * py],
        center_mm: shift(&file.camera, view, [w, h])?,
        microlenses: None,
    })
}

/// Whether the shot says where its camera stands or what it is aimed at.
pub(super) fn is_placed(c: &CameraSection) -> bool {
    c.look_from.is_some() || c.look_at.is_some() || !c.path.is_empty()
}

/// Whether the shot looks through the scene's camera from where that stands.
fn looks_through(c: &CameraSection) -> bool {
    !is_placed(c) && c.calibration.is_none()
}

/// Whether its lens is that of the scene's camera, or an ideal one in its place.
fn is_of_view(c: &CameraSection) -> bool {
    matches!(c.lens.as_deref(), None | Some("thin" | "pinhole")) && c.orthographic.is_none()
}

/// How far the lens is moved against the film, mm: as the shot says, else as the camera of the scene that it looks through.
fn shift(c: &CameraSection, view: Option<&Viewpoint>, film_mm: [f64; 2]) -> Result<[f64; 2], ShotError> {
    let diagonal_mm = film_mm[0].hypot(film_mm[1]);
    let Some(shift) = c.shift_mm else {
        let shift = view.filter(|_| looks_through(c) && is_of_view(c)).map_or([0.0; 2], |v| v.film.shift);
        return Ok(shift.map(|heights| heights * film_mm[1]));
    };
    match shift.iter().all(|s| s.abs() <= diagonal_mm) {
        true => Ok(shift),
        false => Err(value(
            "shift",
            format!("{},{} mm", shift[0], shift[1]),
            format!("at most the film's {diagonal_mm:.1} mm each way"),
        )),
    }
}

/// Reads the calibration that a shot sees by, and writes into the shot what it says: size, film and focal length.
pub(super) fn calibrated(
    file: &mut ShotFile,
    sensor: &Sensor,
    view: Option<&Viewpoint>,
    film: &mut Film,
) -> Result<Option<CameraSource>, ShotError> {
    let Some(path) = file.camera.calibration.clone() else { return Ok(None) };
    let c = &mut file.camera;
    if c.lens.is_some() || c.orthographic.is_some() {
        let found = c.lens.clone().unwrap_or_else(|| "orthographic".into());
        return Err(value("lens", format!("\"{found}\""), "either a lens or a calibration, not both"));
    }
    let of_angle = c.fov_deg.map(|fov| 0.5 / (0.5 * fov.to_radians()).tan());
    let focal_of_width = of_angle.or(c.focal_length.map(|f| f.0 / film.width_mm));
    let source = read_camera(&path, focal_of_width)?;
    let straight = matches!(&source, CameraSource::Rays(_));
    if !straight && focal_of_width.is_some() {
        let found = "beside a calibration";
        return Err(value("focal length", found, "none: the calibration says where the camera looks"));
    }
    if let CameraSource::Model(CameraFile { film_mm: Some([w, h]), .. }) = &source
        && c.format.is_none()
        && c.body.is_none()
    {
        c.format = Some(format!("{w}x{h}"));
    }
    if let (None, Some([width, height])) = (file.render.size, source.size()) {
        file.render.size = Some(Size { width, height });
    }
    *film = self::film(file, sensor, view)?;
    let focal = source.focal_of_width(film.columns).map(|f| LengthMm(f * film.width_mm));
    (file.camera.focal_length, file.camera.fov_deg) = (focal, None);
    Ok(Some(source))
}

/// Turns an angle of view into the focal length of an ideal lens before a film.
pub(super) fn resolve_angle_of_view(file: &mut ShotFile, film: &Film) -> Result<(), ShotError> {
    let c = &mut file.camera;
    let fisheye = c.lens.as_deref().and_then(ideal_fisheye);
    if let Some(fov) = c.fov_deg {
        if c.focal_length.is_some() || !(is_ideal(c) || fisheye.is_some()) {
            let expected = "an ideal lens (thin, pinhole or a fisheye) without a focal length";
            return Err(value("fov", format!("{fov}°"), expected));
        }
        let end = match fisheye {
            None | Some(ModelKind::Orthographic) => 180.0,
            Some(_) => 360.0,
        };
        if !(fov > 0.0 && fov < end) {
            return Err(value("fov", format!("{fov}°"), format!("an angle above 0 and below {end}°")));
        }
        let half = 0.5 * fov.to_radians();
        let radius = fisheye.map_or(half.tan(), |kind| height_of(kind, half));
        c.focal_length = Some(LengthMm(0.5 * film.width_mm / radius));
    } else if let Some(kind) = fisheye.filter(|_| c.focal_length.is_none()) {
        // Half of the sky from corner to corner, as fisheyes that fill the film have it.
        let diagonal = film.width_mm.hypot(film.height_mm);
        c.focal_length = Some(LengthMm(0.5 * diagonal / height_of(kind, std::f64::consts::FRAC_PI_2)));
    }
    Ok(())
}

/// Height in the picture of an angle to the axis, of a focal length of 1.
fn height_of(kind: ModelKind, angle: f64) -> f64 {
    kind.normalized(&[], [angle.sin(), 0.0, angle.cos()])[0]
}

/// Gives objects the classes of the shot's table.
pub(super) fn choose_classes(
    scene: &mut Description,
    section: &SceneSection,
    warn: &mut dyn FnMut(&str),
) -> Result<(), ShotError> {
    let Some(path) = &section.classes else { return Ok(()) };
    let place = path.display().to_string();
    let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
    let table = ClassTable::parse(&text).map_err(|e| ShotError::Syntax { path: place.clone(), reason: e.to_string() })?;
    for (line, pattern) in table.apply(scene) {
        warn(&format!("{place}: line {line}: nothing in the scene is called \"{pattern}\""));
    }
    Ok(())
}

/// The variant of the materials, and which of the bodies are there where they overlap.
pub(super) fn choose_materials(scene: &mut Description, section: &SceneSection) -> Result<(), ShotError> {
    if let Some(name) = &section.variant {
        scene.choose_variant(name).map_err(|expected| value("variant", format!("\"{name}\""), expected))?;
    }
    for (name, number) in &section.priority {
        let mut found = false;
        for material in scene.materials.iter_mut().filter(|m| m.name == *name) {
            let medium = match &material.interior {
                Interior::Body { medium, .. } => medium.clone(),
                Interior::Sides([inside, _]) => inside.clone(),
                Interior::Same => None,
            };
            let solid = matches!(&material.scattering, Scattering::Principled(p) if matches!(p.kind, Transmission::Solid));
            if !solid && !matches!(material.scattering, Scattering::Interface) {
                return Err(value(
                    "priority",
                    format!("\"{name}\""),
                    "a material that light goes into: a body of glass, or the face of a medium",
                ));
            }
            material.interior = Interior::Body { medium, priority: Some(*number) };
            found = true;
        }
        if !found {
            let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
            let expected = match nearest(name, names.iter().copied()) {
                Some(near) => format!("the name of a material (did you mean \"{near}\"?)"),
                None => format!("one of {}", names.join(", ")),
            };
            return Err(value("priority", format!("\"{name}\""), expected));
        }
    }
    Ok(())
}

/// Names of sensors in pbrt-v4 and the bodies that have them here.
const SENSORS: [(&str, &str); 4] = [
    ("canon_eos_5d", "canon-5d"),
    ("canon_eos_5d_mkii", "canon-5d-mark-ii"),
    ("canon_eos_5d_mkiv", "canon-5d-mark-iv"),
    ("nikon_d850", "nikon-d850"),
];

/// Takes body and ISO speed from the scene's film where the shot says nothing; whether anything changed.
pub(super) fn apply_film_hints(file: &mut ShotFile, hints: &FilmHints, warn: &mut dyn FnMut(&str)) -> bool {
    let mut changed = false;
    if let (None, Some(name)) = (&file.camera.body, &hints.sensor) {
        match SENSORS.iter().find(|s| s.0 == name) {
            Some((_, body)) => {
                file.camera.body = Some((*body).to_owned());
                changed = true;
            }
            None => warn(&format!("the scene's sensor \"{name}\" is not known here: give --body for another than the usual one")),
        }
    }
    if let (None, Some(iso), Some(_)) = (file.exposure.iso, hints.iso, &hints.sensor) {
        file.exposure.iso = Some(IsoChoice::Fixed(Iso(iso)));
        changed = true;
    }
    changed
}

/// The camera of the scene that a shot looks through.
pub(super) fn view<'a>(file: &ShotFile, scene: &'a Description) -> Result<Option<&'a Viewpoint>, ShotError> {
    let views = &scene.cameras;
    let Some(wanted) = &file.camera.viewpoint else { return Ok(views.first()) };
    let found = views.iter().find(|v| v.name == *wanted).or_else(|| views.get(wanted.parse::<usize>().ok()?));
    let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
    let expected = match names.is_empty() {
        true => "none: the scene file has no cameras; look_from and look_at place it".to_owned(),
        false => format!("one of {} or its number", names.join(", ")),
    };
    found.map(Some).ok_or_else(|| value("viewpoint", format!("\"{wanted}\""), expected))
}

/// Where the camera stands, by the shot and the scene's description.
pub(super) struct CameraPlacement {
    /// World from camera.
    pub place: Affine3A,
    /// The node of the scene that carries the camera, if one does.
    pub carrier: Option<u32>,
    /// The box around what is photographed.
    pub bounds: Bounds,
    /// Tangents of half the angles of view, across and up, as far as they are known without focusing.
    pub tan_half: [f32; 2],
    /// Those of where the middle of the picture lies.
    pub tan_middle: [f32; 2],
    /// How an embedded scene likes to be photographed.
    framing: Option<builtin::Framing>,
    /// Along the axis to what it is aimed at, m; `None` for the scene's own camera.
    subject_m: Option<f64>,
    /// Set where nobody said where the camera stands.
    framed: Option<Framed>,
    /// Focal length of an ideal lens, mm.
    focal_mm: f64,
    /// Whether that is the distance of the film which the angle of view of the scene's own camera asks for.
    is_of_view: bool,
    /// That of the lens that is asked for, where the camera was placed by it.
    lens_mm: f64,
    own_f_number: Option<f64>,
    /// What the camera sees by, instead of a lens.
    pub calibrated: Option<CameraSource>,
}

impl CameraPlacement {
    /// Whether the camera is inside the box of what it photographs, as in a room.
    pub fn is_within(&self) -> bool {
        let (eye, bounds) = (Vec3::from(self.place.translation), self.bounds);
        eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all()
    }
}

/// Tangents beyond which an angle of view counts as all around.
const WIDEST_TAN: f64 = 20.0;

/// The angle of view of the lens that is asked for; `focal_mm`: of an ideal one.
fn angle(c: &CameraSection, inputs: &Inputs, film: &Film, focal_mm: f64) -> Result<Angle, ShotError> {
    let half = [0.5 * film.width_mm, 0.5 * film.height_mm];
    let ideal = Angle { tan_half: half.map(|h| h / focal_mm), focal_m: Some(focal_mm * 1e-3), real: false };
    let name = match c.lens.as_deref() {
        None | Some("thin") => return Ok(ideal),
        Some("pinhole" | "panorama") => return Ok(Angle { focal_m: None, ..ideal }),
        Some(name) if let Some(kind) = ideal_fisheye(name) => {
            let most = std::f64::consts::FRAC_PI_2;
            let tangent = |height: f64| {
                // The angle whose height is that of the edge.
                let (mut low, mut high) = (0.0, most);
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if height_of(kind, middle) * focal_mm < height { low = middle } else { high = middle }
                }
                low.tan().min(WIDEST_TAN)
            };
            return Ok(Angle { tan_half: half.map(tangent), focal_m: None, ..ideal });
        }
        Some(name) => name,
    };
    let prescription = inputs.lens(name)?;
    let setting = Setting {
        focal_length: stated_focal_length(c, &prescription)?,
        f_number: None,
        focus: Focus::Infinity,
        iris: None,
        film_mm: [film.width_mm, film.height_mm],
    };
    // What is wrong with it is said when it is set.
    let Ok(lens) = CompoundLens::new(std::sync::Arc::new(prescription), &setting) else { return Ok(ideal) };
    let focal_mm = lens.focal_length().0;
    let tangent = |at: DVec2| match lens.chief_ray(at) {
        Ok(ray) if ray.direction.z < 0.0 => (ray.direction.truncate().length() / -ray.direction.z).min(WIDEST_TAN),
        Ok(_) => WIDEST_TAN,
        Err(_) => at.length() / focal_mm,
    };
    let tan_half = [tangent(DVec2::X * half[0]), tangent(DVec2::Y * half[1])];
    Ok(Angle { tan_half, focal_m: Some(focal_mm * 1e-3), real: true })
}

/// Farthest from the origin that anything may be, m: squares of distances stay within single precision.
const LARGEST_M: f32 = 1e12;

/// Finds where the camera stands, before the scene has lamps or ground put into it.
pub(super) fn placement(
    file: &ShotFile,
    inputs: &Inputs,
    description: &Description,
    at_s: f64,
    sensor: &Sensor,
    film: &Film,
    framing: Option<builtin::Framing>,
) -> Result<CameraPlacement, ShotError> {
    let c = &file.camera;
    if let Some(position) = c.zoom_position {
        if c.focal_length.is_some() {
            return Err(value("zoom_position", position, "either a zoom position or a focal length, not both"));
        }
        if matches!(c.lens.as_deref(), None | Some("thin" | "pinhole" | "panorama"))
            || c.lens.as_deref().and_then(ideal_fisheye).is_some()
        {
            return Err(value(
                "zoom_position",
                position,
                "a zoom lens with printed positions, such as lens = \"kit-zoom-18-55mm\"",
            ));
        }
    }
    let view = view(file, description)?;
    let from_fov = |fov: f32| format::focal_length_for(film.height_mm, fov as f64);
    // The body's own lens, unless another lens or film is asked for.
    let own_lens = sensor.lens.filter(|_| is_ideal(c) && c.focal_length.is_none() && c.format.is_none());
    let fov = view.and_then(Viewpoint::vertical_fov).filter(|_| c.focal_length.is_none() && c.look_from.is_none());
    let (focal_mm, own_f_number) = match (c.focal_length, fov, own_lens) {
        (Some(f), ..) => (f.0, None),
        (None, Some(fov), _) => (from_fov(fov), None),
        (None, _, Some(own)) => (own.focal_length_mm, Some(own.f_number)),
        (None, _, None) => (usual_focal_length(framing.map_or(50.0, |f| f.focal_length_mm), c, sensor), None),
    };

    let bounds = description.bounds_at(at_s, |_| true);
    if !bounds.is_empty() && !(bounds.min.abs().max(bounds.max.abs()).max_element() <= LARGEST_M) {
        let [min, max] = [bounds.min, bounds.max].map(|corner| corner.to_array().map(|v| shown(v.into())).join(", "));
        let found = format!("with a surface from [{min}] to [{max}] m");
        return Err(value("scene", found, "coordinates within 1e12 m of the origin"));
    }
    let center = if bounds.is_empty() { Vec3::ZERO } else { bounds.center() };
    let up = c.up.map_or(Vec3::Y, Vec3::from_array);
    let (mut carrier, mut framed, mut tan_half, mut lens_mm) = (None, None, None, focal_mm);
    let (place, subject_m) = if let Some(stop) = c.path.first() {
        let at = stop.look_at.or(c.look_at).map_or(center, Vec3::from_array);
        let from = Vec3::from_array(stop.look_from);
        (look_at(from, at, stop.up.map_or(up, Vec3::from_array))?, Some((at - from).length() as f64))
    } else if let Some(from) = c.look_from.map(Vec3::from_array) {
        let at = c.look_at.map_or(center, Vec3::from_array);
        (look_at(from, at, up)?, Some((at - from).length() as f64))
    } else if c.look_at.is_some() || (view.is_none() && framing.is_none()) {
        let angle = angle(c, inputs, film, focal_mm)?;
        let support = |directions: &[Vec3]| description.support_points(at_s, directions, |_| true);
        let found = framing::framed(center, c.look_at.map(Vec3::from_array), up, &angle, support)?;
        tan_half = Some(angle.tan_half);
        lens_mm = angle.focal_m.map_or(focal_mm, |f| 1e3 * f);
        framed = Some(found);
        (found.place, Some(found.middle_m))
    } else if let Some(framing) = framing {
        (look_at(framing.look_from, framing.look_at, Vec3::Y)?, Some(framing.focus_m))
    } else {
        carrier = view.and_then(|v| v.node);
        let place = match (carrier, view) {
            // Scale of a camera's node has no meaning.
            (Some(node), _) => CameraMotion::still(description.timeline().world(node, at_s)).at(0.0),
            (None, view) => view.map_or(Affine3A::IDENTITY, |v| v.world_from_camera),
        };
        (place, None)
    };
    let tan_half = tan_half.unwrap_or_else(|| {
        let real = c.lens.as_deref().filter(|_| !is_ideal(c) && c.focal_length.is_none());
        let stated = real.and_then(|name| inputs.lens(name).ok()).and_then(|p| {
            let asked = stated_focal_length(c, &p).ok().flatten();
            asked.or(p.focal_length).or(p.zoom.first().copied())
        });
        [film.width_mm, film.height_mm].map(|side| 0.5 * side / stated.unwrap_or(focal_mm))
    });
    // The film is as large as the angle that it sees.
    let tan_middle = [0, 1].map(|k| tan_half[k] * 2.0 * film.center_mm[k] / [film.width_mm, film.height_mm][k]);
    let [tan_half, tan_middle] = [tan_half, tan_middle].map(|tangents| tangents.map(|t| t as f32));
    Ok(CameraPlacement {
        place,
        carrier,
        bounds,
        tan_half,
        tan_middle,
        framing,
        subject_m,
        framed,
        focal_mm,
        is_of_view: fov.is_some(),
        lens_mm,
        own_f_number,
        calibrated: None,
    })
}

/// How fine displaced surfaces shall be: for which camera, and the longest edge in its picture, pixels.
pub(super) type DicingRate = (PixelView, f32);

/// Longest edges of displaced surfaces, pixels.
const EDGES_PX: RangeInclusive<f64> = 0.1..=1000.0;

/// Angles from the axis (rad) are seen to this factor times the corner of the picture: lenses distort, cameras shake and move.
const SEEN_MARGIN: f32 = 1.25;

/// From this half angle on, rad, a camera is taken to see everything around it.
const SEES_ALL: f32 = 1.0;

/// How fine displaced surfaces shall be, where the shot says so.
pub(super) fn dicing_rate(
    file: &ShotFile,
    description: &Description,
    film: &Film,
    placement: &CameraPlacement,
    warn: &mut dyn FnMut(&str),
) -> Result<Option<DicingRate>, ShotError> {
    let Some(edge_px) = file.scene.displacement_edge_px else { return Ok(None) };
    if !EDGES_PX.contains(&edge_px) {
        return Err(value("displacement_edge_px", edge_px, "0.1 to 1000 pixels"));
    }
    if description.displaced.is_empty() {
        warn("the scene has no displaced surfaces: displacement_edge_px changes nothing");
    }
    let [across, up] = placement.tan_half;
    let half_angle = SEEN_MARGIN * across.hypot(up).atan();
    let c = &file.camera;
    let is_panorama =
        c.lens.as_deref() == Some("panorama") || view(file, description)?.is_some_and(|v| v.sight == CameraProjection::Panorama);
    let moves = !c.path.is_empty() || placement.carrier.is_some();
    let around = half_angle > SEES_ALL || is_panorama || moves || placement.calibrated.is_some();
    let view = PixelView {
        eye: placement.place.translation.into(),
        axis: placement.place.transform_vector3(Vec3::NEG_Z).normalize_or(Vec3::NEG_Z),
        half_angle: if around { std::f32::consts::PI } else { half_angle },
        pixels_per_radian: film.columns as f32 / (2.0 * across),
    };
    Ok(Some((view, edge_px as f32)))
}

/// Whether the lens is none with surfaces.
fn is_ideal(c: &CameraSection) -> bool {
    c.lens.as_deref().is_none_or(|l| matches!(l, "thin" | "pinhole"))
}

/// Rays across the part of the picture where focus is looked for, and the parts: the middle, then more of it.
const FOCUS_RAYS: u8 = 12;
const FOCUS_PARTS: [f32; 3] = [0.15, 0.4, 1.0];

/// Along the camera's axis to the nearest point of the subject in the middle of the picture, m; where it has a hole there, in more of it.
fn nearest_in_the_middle(scene: &Scene, placement: &CameraPlacement) -> Option<f64> {
    let d = scene.description();
    let free = |o: &Object| matches!(o.motion, Motion::Carried { node } if d.nodes[node as usize].free);
    let ahead = placement.place.transform_vector3(Vec3::NEG_Z);
    let across = |k: u8, part: f32, tan: f32| (2.0 * f32::from(k) / f32::from(FOCUS_RAYS) - 1.0) * part * tan;
    let depth = |x: f32, y: f32| {
        let [middle_x, middle_y] = placement.tan_middle;
        let direction = placement.place.transform_vector3(Vec3::new(middle_x + x, middle_y + y, -1.0)).normalize();
        let seen = scene.first_surface(&Ray { origin: placement.place.translation.into(), direction, time_s: 0.0 })?;
        d.objects.get(seen.object as usize).filter(|o| !is_staging(o) && !free(o))?;
        Some(f64::from(seen.distance * direction.dot(ahead)))
    };
    FOCUS_PARTS.into_iter().find_map(|part| {
        let [tan_x, tan_y] = placement.tan_half;
        let places = (0..=FOCUS_RAYS).flat_map(|i| (0..=FOCUS_RAYS).map(move |j| (i, j)));
        places.filter_map(|(i, j)| depth(across(i, part, tan_x), across(j, part, tan_y))).min_by(f64::total_cmp)
    })
}

/// Places across and down at which a void is looked for, and the part of the picture from which it is one.
const VOID_GRID: [usize; 2] = [24, 16];
const VOID_PART: f64 = 0.25;

/// Whether much of the picture shows neither a surface nor surroundings.
pub(super) fn is_in_void(scene: &Scene, camera: &Camera) -> bool {
    let [columns, rows] = VOID_GRID;
    let film = Film { columns, rows, microlenses: None, ..camera.film };
    let seen = metering::seen(scene, &Camera { film, ..camera.clone() });
    seen.iter().sum::<f64>() < (1.0 - VOID_PART) * seen.len() as f64
}

/// Apertures that a subject is photographed with by default.
const STOPS: [f64; 5] = [5.6, 8.0, 11.0, 16.0, 22.0];

/// The widest of [`STOPS`] with which all between two distances (m) looks sharp, or the smallest of them.
fn stop_for(focal_mm: f64, film: &Film, focused_m: f64, depths_m: [f64; 2]) -> f64 {
    let circle = film.width_mm.hypot(film.height_mm) * CIRCLE_OF_DIAGONAL;
    let real = |m: f64| 1000.0 * m > 1.001 * focal_mm;
    let smallest = STOPS[STOPS.len() - 1];
    if !real(focused_m) || !depths_m.into_iter().all(real) {
        return smallest;
    }
    // Blur is inversely proportional to the f-number.
    let wanted = depths_m.map(|m| circle_mm(focal_mm, 1.0, focused_m, m) / circle);
    STOPS.into_iter().find(|n| *n >= wanted[0].max(wanted[1])).unwrap_or(smallest)
}
