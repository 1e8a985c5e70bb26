//! Calibration out and in: what the traced lens does, as models, tables and poses that other programs read; and cameras from such files.
//!
//! [`observe`] asks the lens where film points look, [`fit`] finds the model that says the same, [`Calibration`] holds what is known of a camera, and one file each writes and reads a
//! format. The conventions (pixel centres, axes, signs) stand in one table in `docs/calibration.md`; inside, pixels count from the centre of the upper left pixel at (0, 0), and
//! directions are in the camera axes of OpenCV: x to the right, y down, z forward.

pub mod camera_file;
pub mod colmap;
pub mod fit;
pub mod json;
pub mod kalibr;
pub mod lensfun;
pub mod nerfstudio;
pub mod observe;
pub mod opencv;
pub mod pose;
pub mod ray_table;
mod read;
pub mod seen_fields;
pub mod st_map;
mod yaml;

pub use diopter_lens::camera_model::{CameraModel, ModelKind};
pub use fit::Fit;
pub use observe::{Observed, PrincipalRay};
pub use pose::{Frame, Pose};
pub use read::{parse_camera, read_camera};

use crate::camera::Camera;
use diopter_develop::Geometry;
use diopter_lens::{Lens, Projection};
use glam::DVec2;
use std::path::Path;

/// Why a calibration cannot be written or read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what}: {found}; expected {expected}")]
pub struct CalibrationError {
    /// The file format, field or setting.
    pub what: String,
    /// What was found.
    pub found: String,
    /// What is needed.
    pub expected: String,
}

pub(crate) fn wrong(what: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> CalibrationError {
    CalibrationError { what: what.into(), found: found.into(), expected: expected.into() }
}

/// What is known of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Camera body.
    pub body: String,
    /// Lens.
    pub lens: String,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Size of the film that they cover, mm.
    pub film_mm: [f64; 2],
    /// Focal length of the lens, mm.
    pub focal_length_mm: f64,
    /// f-number.
    pub f_number: f64,
    /// Distance of the plane in focus, m; `None` for infinity.
    pub focus_distance_m: Option<f64>,
    /// Where directions are seen.
    pub model: CameraModel,
    /// How well the model says what the lens does; `None` where it is the camera itself.
    pub fit: Option<Fit>,
    /// Light over the picture, of that in its middle: at equal steps of the distance from the middle, up to half the diagonal. Empty where it is not known.
    pub falloff: Vec<f64>,
    /// Pictures and where the camera was; empty of a lens alone.
    pub frames: Vec<Frame>,
}

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Everything, our own.
    Json,
    /// OpenCV's FileStorage (YAML), also for ROS.
    OpenCv,
    /// COLMAP `cameras.txt`.
    ColmapCameras,
    /// COLMAP `images.txt`.
    ColmapImages,
    /// nerfstudio and Instant-NGP `transforms.json`.
    Nerfstudio,
    /// Kalibr's camera chain (YAML).
    Kalibr,
    /// lensfun database (XML).
    Lensfun,
    /// ST map (EXR) that distorts: for each pixel of the camera its place in the straight picture.
    StDistort,
    /// ST map (EXR) that undistorts: for each pixel of the straight picture its place in the camera's.
    StUndistort,
    /// A ray for each pixel (EXR).
    RayTable,
}

impl Format {
    /// All of them with their names.
    pub const NAMES: [(&'static str, Format); 10] = [
        ("json", Format::Json),
        ("opencv", Format::OpenCv),
        ("colmap", Format::ColmapCameras),
        ("colmap-images", Format::ColmapImages),
        ("nerfstudio", Format::Nerfstudio),
        ("kalibr", Format::Kalibr),
        ("lensfun", Format::Lensfun),
        ("st-map", Format::StDistort),
        ("st-map-undistort", Format::StUndistort),
        ("ray-table", Format::RayTable),
    ];

    /// The format of a name. Fails on one that is not in [`Format::NAMES`].
    pub fn named(name: &str) -> Result<Format, CalibrationError> {
        let all = Self::NAMES.map(|n| n.0).join(", ");
        Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1).ok_or_else(|| wrong("format", format!("\"{name}\""), all))
    }

    /// How names of its files end.
    pub fn ending(self) -> &'static str {
        match self {
            Format::Json | Format::Nerfstudio => "json",
            Format::OpenCv | Format::Kalibr => "yaml",
            Format::ColmapCameras | Format::ColmapImages => "txt",
            Format::Lensfun => "xml",
            Format::StDistort | Format::StUndistort | Format::RayTable => "exr",
        }
    }

    /// Whether a file may hold it by the ending of its name: its own, or one that says no format.
    pub fn suits(self, path: &Path) -> bool {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let ending = if ending == "yml" { "yaml" } else { ending.as_str() };
        ending == self.ending() || Self::NAMES.iter().all(|(_, format)| format.ending() != ending)
    }

    /// The format that the name of a file says. `None` where it does not say one.
    pub fn of(path: &Path) -> Option<Format> {
        let name = path.file_stem()?.to_string_lossy().to_lowercase();
        let ending = path.extension()?.to_string_lossy().to_lowercase();
        let says = |words: &[&str]| words.iter().any(|w| name.contains(w));
        match ending.as_str() {
            "json" => Some(if says(&["transforms"]) { Format::Nerfstudio } else { Format::Json }),
            "yaml" | "yml" => Some(if says(&["kalibr", "camchain"]) { Format::Kalibr } else { Format::OpenCv }),
            "txt" if says(&["images"]) => Some(Format::ColmapImages),
            "txt" if says(&["camera"]) => Some(Format::ColmapCameras),
            "xml" => Some(Format::Lensfun),
            "exr" if says(&["undistort"]) => Some(Format::StUndistort),
            "exr" if says(&["distort", "stmap", "st_map", "st-map"]) => Some(Format::StDistort),
            "exr" if says(&["ray"]) => Some(Format::RayTable),
            _ => None,
        }
    }

    /// Whether it can hold a camera of its own for each picture.
    pub fn holds_cameras(self) -> bool {
        matches!(self, Format::Json | Format::Nerfstudio)
    }

    /// Whether it holds poses and models alone, and no tables of pixels.
    pub fn is_text(self) -> bool {
        !matches!(self, Format::StDistort | Format::StUndistort | Format::RayTable)
    }
}

/// The calibration of a camera: its own model where it has one, else one fitted to where its lens looks (`kind`, or a suitable one). Names and frames are left empty.
/// Fails as [`fit::fit`].
pub fn of_camera(camera: &Camera, kind: Option<ModelKind>, which: PrincipalRay) -> Result<Calibration, CalibrationError> {
    let (lens, film) = (&camera.lens, &camera.film);
    let size = [film.columns, film.rows];
    if let Lens::Pinhole(hole) = lens {
        let what = match hole.projection {
            Projection::Panorama { .. } => Some("a panorama, which looks all around"),
            Projection::Orthographic { .. } => Some("a parallel projection, which looks one way from everywhere"),
            Projection::Rectilinear => None,
        };
        if let Some(what) = what {
            return Err(wrong(
                "calibration",
                what,
                "a camera that looks from one point through an image plane: pinhole, thin, a prescription or a fisheye",
            ));
        }
    }
    let own = match lens {
        Lens::Calibrated(ideal) if kind.is_none() && film.center_mm == [0.0; 2] => json::of_ideal(ideal).map(|model| {
            let [w, h] = ideal.grid().size;
            model.scaled(DVec2::new(size[0] as f64 / w as f64, size[1] as f64 / h as f64))
        }),
        _ => None,
    };
    let (model, fit) = match own {
        Some(model) => (model, None),
        None => {
            let observed = observe::observe(lens, film, which);
            let straight = match lens {
                Lens::Thin(_) => true,
                Lens::Pinhole(hole) => hole.projection == Projection::Rectilinear,
                _ => false,
            };
            let kind = kind.unwrap_or_else(|| if straight { ModelKind::Pinhole } else { fit::suitable(&observed) });
            let found = fit::fit(kind, &observed)?;
            (found.model.clone(), Some(found))
        }
    };
    Ok(Calibration {
        body: String::new(),
        lens: String::new(),
        size,
        film_mm: [film.width_mm, film.height_mm],
        focal_length_mm: lens.focal_length().0,
        f_number: lens.f_number(),
        focus_distance_m: lens.focus_distance().map(|d| d.0 / 1000.0),
        model,
        fit,
        falloff: observe::falloff(lens, film),
        frames: Vec::new(),
    })
}

impl Calibration {
    /// The calibration of the developed picture, for one of what was taken: scaled with it, and straight where its development makes it straight.
    #[must_use]
    pub fn developed(mut self, geometry: &Geometry) -> Self {
        let taken = DVec2::new(self.size[0] as f64, self.size[1] as f64);
        let scale = DVec2::from(geometry.scale);
        let straight = geometry.straight.and_then(|focal| {
            let focal = DVec2::splat(0.5 * focal * taken.length());
            CameraModel::new(ModelKind::Pinhole, focal, 0.5 * (taken - 1.0), Vec::new()).ok()
        });
        if let Some(straight) = straight {
            (self.model, self.fit) = (straight, None);
        }
        self.model = self.model.scaled(scale);
        if let Some(fit) = &mut self.fit {
            // A distance in the picture grows with it.
            let mean = (scale.x * scale.y).sqrt();
            (fit.model, fit.rms_px, fit.max_px) = (self.model.clone(), fit.rms_px * mean, fit.max_px * mean);
            fit.map.iter_mut().flatten().for_each(|d| *d *= scale);
        }
        self.size = geometry.size;
        self
    }

    /// The text of a file. Fails on a model that the format cannot say, and on poses where there are none.
    pub fn text(&self, format: Format) -> Result<String, CalibrationError> {
        let own = self.frames.iter().filter(|f| f.camera.is_some()).count();
        if own > 0 && !format.holds_cameras() {
            return Err(wrong(
                "calibration",
                format!("{own} pictures with a focus of their own"),
                "a .json or transforms.json file, which hold a camera for each picture",
            ));
        }
        match format {
            Format::Json => Ok(json::write(self)),
            Format::OpenCv => opencv::write(self),
            Format::ColmapCameras => colmap::write_cameras(self),
            Format::ColmapImages => colmap::write_images(self),
            Format::Nerfstudio => nerfstudio::write(self),
            Format::Kalibr => kalibr::write(self),
            Format::Lensfun => lensfun::write(self),
            Format::StDistort | Format::StUndistort | Format::RayTable => {
                Err(wrong("format", "a table of pixels", "a text format here: `lens calibrate` writes ST maps and ray tables"))
            }
        }
    }

    /// The error of a format that has no such model.
    fn cannot(&self, format: &str, models: &str) -> CalibrationError {
        wrong(
            format,
            format!("the model {}", self.model.kind().name()),
            format!("one of {models}: choose it by --model of `diopter lens calibrate`"),
        )
    }

    /// Coefficients as OpenCV orders them, as many as OpenCV takes, and whether they are those of its fisheye module; `None` for models that OpenCV has not.
    pub(crate) fn opencv_coefficients(&self) -> Option<(Vec<f64>, bool)> {
        let mut k = self.model.coefficients().to_vec();
        let (count, fisheye) = match self.model.kind() {
            ModelKind::Pinhole => (5, false),
            ModelKind::SimpleRadial | ModelKind::Radial | ModelKind::OpenCv4 => (4, false),
            ModelKind::OpenCv5 | ModelKind::OpenCv8 | ModelKind::OpenCv12 | ModelKind::OpenCv14 => (k.len(), false),
            ModelKind::Fisheye | ModelKind::Equidistant => (4, true),
            _ => return None,
        };
        k.resize(count, 0.0);
        Some((k, fisheye))
    }
}

/// A number as every reader of YAML and text takes it for one with a fraction: no exponent, all digits.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{value}");
    if text.contains('.') { text } else { format!("{text}.0") }
}

/// Several of them.
pub(crate) fn numbers(values: &[f64], between: &str) -> String {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(between)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::{DAffine3, DQuat, DVec3};

    /// A calibration with numbers of its own.
    pub(crate) fn sample(kind: ModelKind) -> Calibration {
        let k: Vec<f64> =
            kind.coefficients().iter().enumerate().map(|(i, _)| 0.01 * (i as f64 + 1.0) * (-1f64).powi(i as i32)).collect();
        let model = CameraModel::new(kind, DVec2::new(801.25, 799.5), DVec2::new(479.75, 318.5), k).unwrap();
        let place = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.5), DVec3::new(1.0, 2.0, 3.0));
        let pose = |when, time_s| Pose { row: None, when, time_s, world_from_camera: place };
        Calibration {
            body: "body".into(),
            lens: "lens \"A\"".into(),
            size: [960, 640],
            film_mm: [36.0, 24.0],
            focal_length_mm: 30.0,
            f_number: 2.8,
            focus_distance_m: Some(2.5),
            model,
            fit: None,
            falloff: vec![1.0, 0.9, 0.5],
            frames: vec![Frame {
                picture: "a.jpg".into(),
                at_s: 0.0,
                camera: None,
                poses: vec![pose("start", 0.0), pose("middle", 0.5), pose("end", 1.0)],
                moving: Vec::new(),
            }],
        }
    }

    #[test]
    fn a_developed_picture_has_a_camera_of_its_own() {
        let taken = sample(ModelKind::OpenCv5);
        let geometry = Geometry { size: [480, 160], scale: [0.5, 0.25], straight: None };
        let small = taken.clone().developed(&geometry);
        assert_eq!(small.size, [480, 160]);
        // Corners of pictures stay corners: pixel centres are half a pixel from them.
        let direction = DVec3::new(0.2, -0.1, 1.0);
        let (before, after) = (taken.model.project(direction).unwrap(), small.model.project(direction).unwrap());
        assert!(((before + 0.5) * DVec2::new(0.5, 0.25) - 0.5 - after).length() < 1e-9, "{before} {after}");
        let straight = taken.developed(&Geometry { size: [960, 640], scale: [1.0, 1.0], straight: Some(1.5) });
        let half = 0.5 * DVec2::new(960.0, 640.0).length();
        let expected = DVec2::new(479.5, 319.5) + direction.truncate() * (1.5 * half);
        assert!((straight.model.project(direction).unwrap() - expected).length() < 1e-9);
        assert_eq!((straight.model.kind(), straight.fit), (ModelKind::Pinhole, None));
    }

    #[test]
    fn pictures_focused_elsewhere_have_cameras_of_their_own_where_a_format_can_say_so() {
        let mut series = sample(ModelKind::Pinhole);
        let mut second = series.frames[0].clone();
        second.camera = Some((series.model.scaled(DVec2::splat(2.0)), Some(1.0)));
        series.frames.push(second);
        for (_, format) in Format::NAMES.iter().filter(|n| n.1.is_text()) {
            let text = series.text(*format);
            assert_eq!(text.is_ok(), format.holds_cameras(), "{format:?}");
        }
        let text: serde_json::Value = serde_json::from_str(&series.text(Format::Nerfstudio).unwrap()).unwrap();
        let focal = |k: usize| text["frames"][k]["fl_x"].as_f64().unwrap();
        assert!(text.get("fl_x").is_none() && (focal(1) / focal(0) - 2.0).abs() < 1e-12, "{text}");
        let text: serde_json::Value = serde_json::from_str(&series.text(Format::Json).unwrap()).unwrap();
        assert_eq!(
            (&text["frames"][0]["model"], text["frames"][1]["focus_distance_m"].as_f64()),
            (&serde_json::Value::Null, Some(1.0))
        );
    }

    #[test]
    fn names_say_the_format() {
        for (name, format) in [
            ("calibration.json", Some(Format::Json)),
            ("a/transforms_train.json", Some(Format::Nerfstudio)),
            ("camera.yml", Some(Format::OpenCv)),
            ("camchain.yaml", Some(Format::Kalibr)),
            ("sparse/cameras.txt", Some(Format::ColmapCameras)),
            ("images.txt", Some(Format::ColmapImages)),
            ("lens.xml", Some(Format::Lensfun)),
            ("undistort.exr", Some(Format::StUndistort)),
            ("stmap.exr", Some(Format::StDistort)),
            ("rays.exr", Some(Format::RayTable)),
            ("photo.exr", None),
            ("notes.txt", None),
            ("photo.jpg", None),
        ] {
            assert_eq!(Format::of(Path::new(name)), format, "{name}");
        }
        assert!(Format::named("opencw").is_err());
    }

    #[test]
    fn what_is_written_is_read_again() {
        for (format, kinds) in [
            (
                Format::OpenCv,
                &[ModelKind::OpenCv4, ModelKind::OpenCv5, ModelKind::OpenCv8, ModelKind::OpenCv14, ModelKind::Fisheye][..],
            ),
            (
                Format::ColmapCameras,
                &[ModelKind::Pinhole, ModelKind::OpenCv4, ModelKind::OpenCv8, ModelKind::Fisheye, ModelKind::ThinPrismFisheye],
            ),
            (Format::Nerfstudio, &[ModelKind::OpenCv4, ModelKind::Fisheye]),
            (Format::Kalibr, &[ModelKind::OpenCv4, ModelKind::Fisheye, ModelKind::DoubleSphere]),
            (Format::Json, &[ModelKind::OpenCv12, ModelKind::FTheta, ModelKind::Division, ModelKind::Stereographic]),
        ] {
            for kind in kinds {
                let out = sample(*kind);
                let text = out.text(format).unwrap();
                let read = parse_camera(&text, "file").unwrap_or_else(|e| panic!("{format:?} {kind:?}: {e}\n{text}"));
                assert_eq!((read.size, read.model.kind()), (Some(out.size), *kind), "{text}");
                // Half pixels are added and taken away again, and JSON is read to the last digit but one.
                let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
                assert!((read.model.centre() - out.model.centre()).length() < 1e-9, "{text}");
                assert!((read.model.focal() - out.model.focal()).length() < 1e-9, "{text}");
                assert!(read.model.coefficients().iter().zip(out.model.coefficients()).all(|(a, b)| near(*a, *b)), "{text}");
            }
        }
        // What a format cannot say is an error that names what it can.
        let e = sample(ModelKind::FTheta).text(Format::OpenCv).unwrap_err().to_string();
        assert!(e.contains("f-theta") && e.contains("opencv5"), "{e}");
        let e = parse_camera("hello", "file.txt").unwrap_err().to_string();
        assert!(e.contains("file.txt"), "{e}");
    }
}
