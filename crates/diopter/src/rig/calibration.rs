//! The calibration of a whole rig for other programs: Kalibr, COLMAP, nerfstudio, OpenCV, and our own JSON.
//!
//! Conventions are those of `docs/calibration.md`. In every format but ours a camera has the model that says its lens best among those that the format knows. Poses of pictures are those in the
//! middle of the exposure (of the middle row of a rolling shutter). Sources: Kalibr wiki, "YAML formats" (`T_cn_cnm1`, `T_cam_imu`, `timeshift_cam_imu`: t_imu = t_cam + shift);
//! COLMAP documentation, "Rig support" and "Output format" (from 3.12 on); nerfstudio, "Data conventions"; OpenCV, `stereoCalibrate`.

use super::imu::{Imu, nanoseconds};
use super::path::RigPath;
use crate::calibration::{self, Calibration, CalibrationError, Format, ModelKind, PrincipalRay, number, numbers, wrong};
use crate::camera::Camera;
use diopter_develop::Geometry;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use serde_json::{Value, json};
use std::fmt::Write;

/// Axes x right, y down, z forward from x right, y up, z backward, and the other way.
const FLIP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);

/// A kind of file that says the whole rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RigFormat {
    /// `calibration/rig.json`, our own, with models, mounts and all poses.
    Json,
    /// `calibration/camchain.yaml`.
    Kalibr,
    /// `calibration/colmap/`: `rig_config.json` and the text model.
    Colmap,
    /// `transforms.json`.
    Nerfstudio,
    /// `calibration/stereo-A-B.yaml` for pairs of cameras.
    OpenCv,
    /// `CAMERA/data.csv`: stamps and pictures as EuRoC has them.
    Euroc,
}

impl RigFormat {
    /// All of them with their names.
    pub const NAMES: [(&'static str, RigFormat); 6] = [
        ("json", RigFormat::Json),
        ("kalibr", RigFormat::Kalibr),
        ("colmap", RigFormat::Colmap),
        ("nerfstudio", RigFormat::Nerfstudio),
        ("opencv", RigFormat::OpenCv),
        ("euroc", RigFormat::Euroc),
    ];
}

/// A picture of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its file, relative to the folder of the rig, with slashes.
    pub file: String,
    /// Time of the frame, s: the same for all cameras.
    pub stamp_s: f64,
    /// The middle of its exposure, s.
    pub moment_s: f64,
    /// Then; axes x right, y up, z backward.
    pub world_from_camera: DAffine3,
}

/// What is known of a camera of a rig.
#[derive(Clone, Debug)]
pub struct CameraOfRig<'a> {
    /// Name.
    pub name: &'a str,
    /// Lens and film.
    pub camera: &'a Camera,
    /// Its own model.
    pub calibration: Calibration,
    /// Where a development puts what it takes; `None` of raw files.
    pub geometry: Option<Geometry>,
    /// Its mount; axes of both x right, y up, z backward.
    pub rig_from_camera: DAffine3,
    /// From the time of a frame to the beginning of its exposure, s.
    pub trigger_s: f64,
    /// From there to the middle of it, s.
    pub middle_s: f64,
    /// Its pictures.
    pub pictures: Vec<Picture>,
}

/// What is known of a rig.
#[derive(Clone, Debug)]
pub struct RigCalibration<'a> {
    /// The cameras.
    pub cameras: Vec<CameraOfRig<'a>>,
    /// The path.
    pub path: &'a RigPath,
    /// The inertial sensor.
    pub imu: Option<&'a Imu>,
    /// The ray that stands for a pixel.
    pub which: PrincipalRay,
}

/// The same transform between parts whose axes are OpenCV's.
fn opencv_axes(a_from_b: &DAffine3) -> DAffine3 {
    DAffine3 { matrix3: FLIP * a_from_b.matrix3 * FLIP, translation: FLIP * a_from_b.translation }
}

/// Camera from world with the axes of OpenCV.
fn camera_from_world(world_from_camera: &DAffine3) -> DAffine3 {
    let inverse = world_from_camera.inverse();
    DAffine3 { matrix3: FLIP * inverse.matrix3, translation: FLIP * inverse.translation }
}

/// Quaternion (w ≥ 0) and translation as COLMAP orders them: w x y z, x y z.
fn colmap_pose(t: &DAffine3) -> [f64; 7] {
    let q = DQuat::from_mat3(&t.matrix3).normalize();
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.x, q.y, q.z, t.translation.x, t.translation.y, t.translation.z]
}

fn rows(m: &DAffine3) -> [[f64; 4]; 4] {
    DMat4::from(*m).transpose().to_cols_array_2d()
}

/// A square matrix row by row.
fn flat(m: &DMat3) -> [f64; 9] {
    m.transpose().to_cols_array()
}

/// The cross product with a vector as a matrix.
fn cross(t: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0))
}

/// Rotation, translation, essential and fundamental matrix of two cameras as OpenCV has them: x₂ = R x₁ + T, x₂ᵀ E x₁ = 0 of normalized places, p₂ᵀ F p₁ = 0 of pixels. F has the norm 1.
///
/// Source: Hartley & Zisserman 2004, §9.2 and §9.6; OpenCV, `stereoCalibrate`. `k`: camera matrices of the first and the second, pixels; T in m.
pub fn stereo(second_from_first: &DAffine3, k: [DMat3; 2]) -> (DMat3, DVec3, DMat3, DMat3) {
    let m = opencv_axes(second_from_first);
    let e = cross(m.translation) * m.matrix3;
    let f = k[1].inverse().transpose() * e * k[0].inverse();
    let norm = f.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    (m.matrix3, m.translation, e, if norm > 0.0 { f * (1.0 / norm) } else { f })
}

impl CameraOfRig<'_> {
    /// The calibration with a model of a kind.
    fn fitted(&self, kind: ModelKind, which: PrincipalRay) -> Result<Calibration, CalibrationError> {
        let taken = calibration::of_camera(self.camera, Some(kind), which)?;
        Ok(self.geometry.iter().fold(taken, Calibration::developed))
    }

    /// The calibration with a model that a format can say: its own, or the best of several.
    fn said(&self, format: Format, kinds: &[ModelKind], which: PrincipalRay) -> Result<Calibration, CalibrationError> {
        let own = self.calibration.text(format);
        let Err(cannot) = own else { return Ok(self.calibration.clone()) };
        let fits = kinds.iter().filter_map(|kind| self.fitted(*kind, which).ok());
        let rms = |c: &Calibration| c.fit.as_ref().map_or(0.0, |f| f.rms_px);
        let best = fits.min_by(|a, b| rms(a).total_cmp(&rms(b)));
        let best = best.ok_or_else(|| wrong(format!("camera \"{}\"", self.name), cannot.found, cannot.expected))?;
        let (body, lens) = (self.calibration.body.clone(), self.calibration.lens.clone());
        Ok(Calibration { body, lens, frames: Vec::new(), ..best })
    }
}

impl RigCalibration<'_> {
    /// All files of some formats: names relative to the folder of the rig, and texts. Fails where a format knows no model for a lens.
    pub fn files(&self, formats: &[RigFormat]) -> Result<Vec<(String, String)>, CalibrationError> {
        let mut files = Vec::new();
        for format in formats {
            match format {
                RigFormat::Json => files.push(("calibration/rig.json".into(), self.json())),
                RigFormat::Kalibr => files.push(("calibration/camchain.yaml".into(), self.kalibr()?)),
                RigFormat::Colmap => files.extend(self.colmap()?),
                RigFormat::Nerfstudio => files.push(("transforms.json".into(), self.nerfstudio()?)),
                RigFormat::OpenCv => {
                    for (a, b) in self.pairs() {
                        let name = format!("calibration/stereo-{}-{}.yaml", self.cameras[a].name, self.cameras[b].name);
                        files.push((name, self.opencv(a, b)?));
                    }
                }
                RigFormat::Euroc => files.extend(self.cameras.iter().map(|c| {
                    let mut text = "#timestamp [ns],filename\n".to_owned();
                    for p in &c.pictures {
                        let name = p.file.rsplit('/').next().unwrap_or(&p.file);
                        let _ = writeln!(text, "{},{name}", nanoseconds(p.stamp_s));
                    }
                    (format!("{}/data.csv", c.name), text)
                })),
            }
        }
        Ok(files)
    }

    /// Pairs for stereo: all of a few cameras, neighbours of many.
    fn pairs(&self) -> Vec<(usize, usize)> {
        let n = self.cameras.len();
        match n {
            0..=4 => (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect(),
            _ => (1..n).map(|b| (b - 1, b)).collect(),
        }
    }

    /// One camera from another.
    fn relative(&self, to: usize, from: usize) -> DAffine3 {
        self.cameras[to].rig_from_camera.inverse() * self.cameras[from].rig_from_camera
    }

    fn json(&self) -> String {
        let pose = |m: &DAffine3| json!(rows(m)[..3]);
        let cameras: Vec<Value> = self
            .cameras
            .iter()
            .map(|c| {
                let pictures: Vec<Value> = c
                    .pictures
                    .iter()
                    .map(|p| json!({ "file": p.file, "time_s": p.stamp_s, "moment_s": p.moment_s, "world_from_camera": pose(&p.world_from_camera) }))
                    .collect();
                json!({
                    "name": c.name, "body": c.calibration.body, "lens": c.calibration.lens, "size": c.calibration.size,
                    "model": calibration::json::model(&c.calibration.model),
                    "fit": c.calibration.fit.as_ref().map(calibration::json::fit),
                    "rig_from_camera": pose(&c.rig_from_camera), "trigger_offset_s": c.trigger_s, "middle_of_exposure_s": c.middle_s,
                    "pictures": pictures,
                })
            })
            .collect();
        let imu = self
            .imu
            .map(|i| json!({ "rig_from_imu": pose(&i.rig_from_imu), "rate_hz": i.rate_hz, "gravity": i.gravity.to_array() }));
        // Axes of rig, cameras and IMU: x right, y up, z backward.
        format!("{:#}\n", json!({ "axes": "x right, y up, z backward; m", "cameras": cameras, "imu": imu }))
    }

    fn kalibr(&self) -> Result<String, CalibrationError> {
        let kinds = [ModelKind::OpenCv4, ModelKind::Fisheye, ModelKind::DoubleSphere];
        let matrix = |m: &DAffine3| rows(m).map(|r| format!("  - [{}]\n", numbers(&r, ", "))).concat();
        let mut text = String::new();
        for (k, camera) in self.cameras.iter().enumerate() {
            let own = camera.said(Format::Kalibr, &kinds, self.which)?.text(Format::Kalibr)?;
            let _ = writeln!(text, "cam{k}:");
            if k > 0 {
                let _ = write!(text, "  T_cn_cnm1:\n{}", matrix(&opencv_axes(&self.relative(k, k - 1))));
            }
            if let Some(imu) = self.imu {
                // The IMU's axes stay its own; the camera's are OpenCV's.
                let m = camera.rig_from_camera.inverse() * imu.rig_from_imu;
                let m = DAffine3 { matrix3: FLIP * m.matrix3, translation: FLIP * m.translation };
                let shift = number(camera.trigger_s + camera.middle_s);
                let _ = write!(text, "  T_cam_imu:\n{}  timeshift_cam_imu: {shift}\n", matrix(&m));
            }
            let others: Vec<String> = (0..self.cameras.len()).filter(|i| *i != k).map(|i| i.to_string()).collect();
            let _ = writeln!(text, "  cam_overlaps: [{}]", others.join(", "));
            let kept = own.lines().skip(1).filter(|l| !l.starts_with("  cam_overlaps") && !l.starts_with("  rostopic"));
            kept.for_each(|l| text.extend([l, "\n"]));
            // Names of ROS have letters, digits and underscores. Source: ROS wiki, "Names".
            let _ = writeln!(text, "  rostopic: /{}/image_raw", camera.name.replace(|c: char| !c.is_ascii_alphanumeric(), "_"));
        }
        Ok(text)
    }

    /// Cameras that see the rig in one place at each frame, in their order: rigs of COLMAP.
    fn rigid_groups(&self) -> Vec<Vec<usize>> {
        let moment = |k: usize| self.cameras[k].trigger_s + self.cameras[k].middle_s;
        let mut groups: Vec<Vec<usize>> = vec![];
        for k in 0..self.cameras.len() {
            let is_with = |group: &&mut Vec<usize>| self.path.is_still() || (moment(group[0]) - moment(k)).abs() < 1e-9;
            match groups.iter_mut().find(is_with) {
                Some(group) => group.push(k),
                None => groups.push(vec![k]),
            }
        }
        groups
    }

    fn colmap(&self) -> Result<Vec<(String, String)>, CalibrationError> {
        let kinds = [ModelKind::OpenCv8, ModelKind::Fisheye, ModelKind::ThinPrismFisheye];
        let n = self.cameras.len();
        let groups = self.rigid_groups();
        let mut cameras = format!(
            "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {n}\n"
        );
        let mut entries = Vec::new();
        for (k, camera) in self.cameras.iter().enumerate() {
            let text = camera.said(Format::ColmapCameras, &kinds, self.which)?.text(Format::ColmapCameras)?;
            let line = text.lines().last().unwrap_or("");
            let words: Vec<&str> = line.split(' ').skip(1).collect();
            let _ = writeln!(cameras, "{} {}", k + 1, words.join(" "));
            let parameters: Vec<f64> = words.iter().skip(3).filter_map(|w| w.parse().ok()).collect();
            entries.push(json!({
                "image_prefix": format!("{}/", camera.name), "camera_model_name": words.first(), "camera_params": parameters,
            }));
        }
        let count = self.cameras[0].pictures.len();
        let (mut rigs, mut frames, mut images) = (String::new(), String::new(), String::new());
        let _ = write!(
            images,
            "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
             #   POINTS2D[] as (X, Y, POINT3D_ID)\n# Number of images: {}, mean observations per image: 0\n",
            count * n
        );
        let _ = write!(
            frames,
            "# Frame list with one line of data per frame:\n\
             #   FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)\n\
             # Number of frames: {}\n",
            count * groups.len()
        );
        let _ = write!(
            rigs,
            "# Rig calib list with one line of data per calib:\n\
             #   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n\
             # Number of rigs: {}\n",
            groups.len()
        );
        // Cameras of a moving rig that are exposed one after the other are no rig of COLMAP.
        let mut config = Vec::new();
        for (g, group) in groups.iter().enumerate() {
            let reference = group[0];
            let _ = write!(rigs, "{} {} CAMERA {}", g + 1, group.len(), reference + 1);
            entries[reference]["ref_sensor"] = json!(true);
            for &k in &group[1..] {
                let pose = colmap_pose(&opencv_axes(&self.relative(k, reference)));
                let _ = write!(rigs, " CAMERA {} 1 {}", k + 1, numbers(&pose, " "));
                entries[k]["cam_from_rig_rotation"] = json!(pose[..4]);
                entries[k]["cam_from_rig_translation"] = json!(pose[4..]);
            }
            rigs.push('\n');
            config.push(json!({ "cameras": group.iter().map(|k| entries[*k].clone()).collect::<Vec<_>>() }));
        }
        let image = |frame: usize, camera: usize| frame * n + camera + 1;
        for frame in 0..count {
            let pose =
                |k: usize| numbers(&colmap_pose(&camera_from_world(&self.cameras[k].pictures[frame].world_from_camera)), " ");
            for (k, camera) in self.cameras.iter().enumerate() {
                let _ = write!(images, "{} {} {} {}\n\n", image(frame, k), pose(k), k + 1, camera.pictures[frame].file);
            }
            for (g, group) in groups.iter().enumerate() {
                let ids: Vec<String> = group.iter().map(|k| format!("CAMERA {} {}", k + 1, image(frame, *k))).collect();
                let id = frame * groups.len() + g + 1;
                let _ = writeln!(frames, "{id} {} {} {} {}", g + 1, pose(group[0]), group.len(), ids.join(" "));
            }
        }
        let points = "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n\
                      # Number of points: 0, mean track length: 0\n";
        let config = format!("{:#}\n", json!(config));
        let file = |name: &str, text: String| (format!("calibration/colmap/{name}"), text);
        Ok(vec![
            file("rig_config.json", config),
            file("cameras.txt", cameras),
            file("rigs.txt", rigs),
            file("frames.txt", frames),
            file("images.txt", images),
            file("points3D.txt", points.to_owned()),
        ])
    }

    fn nerfstudio(&self) -> Result<String, CalibrationError> {
        let of = |c: &CameraOfRig, kinds: &[ModelKind]| -> Result<Value, CalibrationError> {
            let text = c.said(Format::Nerfstudio, kinds, self.which)?.text(Format::Nerfstudio)?;
            serde_json::from_str(&text).map_err(|e| wrong("transforms.json", e.to_string(), "JSON"))
        };
        let usual = [ModelKind::OpenCv5, ModelKind::Fisheye];
        let mut own = self.cameras.iter().map(|c| of(c, &usual)).collect::<Result<Vec<Value>, _>>()?;
        // One file has one model of camera: where lenses differ, that of fisheyes, which says straight ones as well.
        if own.iter().any(|v| v["camera_model"] != own[0]["camera_model"]) {
            for (value, camera) in own.iter_mut().zip(&self.cameras) {
                if value["camera_model"] != "OPENCV_FISHEYE" {
                    let fitted = camera.fitted(ModelKind::Fisheye, self.which)?;
                    let text = fitted.text(Format::Nerfstudio)?;
                    *value = serde_json::from_str(&text).map_err(|e| wrong("transforms.json", e.to_string(), "JSON"))?;
                }
            }
        }
        let mut whole = json!({ "camera_model": own[0]["camera_model"] });
        if !own[0]["is_fisheye"].is_null() {
            whole["is_fisheye"] = own[0]["is_fisheye"].clone();
        }
        let mut frames = Vec::new();
        for frame in 0..self.cameras[0].pictures.len() {
            for (camera, own) in self.cameras.iter().zip(&own) {
                let p = &camera.pictures[frame];
                let mut v = json!({ "file_path": p.file, "transform_matrix": rows(&p.world_from_camera), "time": p.moment_s, "camera": camera.name });
                for key in ["fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2"] {
                    if !own[key].is_null() {
                        v[key] = own[key].clone();
                    }
                }
                frames.push(v);
            }
        }
        whole["frames"] = json!(frames);
        Ok(format!("{whole:#}\n"))
    }

    fn opencv(&self, a: usize, b: usize) -> Result<String, CalibrationError> {
        let kinds = [ModelKind::OpenCv8, ModelKind::OpenCv14, ModelKind::Fisheye];
        let matrix = |name: &str, rows: usize, cols: usize, data: &[f64]| {
            format!("{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]\n", numbers(data, ", "))
        };
        let mut text = "%YAML 1.0\n---\n".to_owned();
        let mut k = [DMat3::IDENTITY; 2];
        for (i, at) in [a, b].into_iter().enumerate() {
            let camera = &self.cameras[at];
            let said = camera.said(Format::OpenCv, &kinds, self.which)?;
            let (f, m) = (said.model.focal(), said.model.centre());
            k[i] = DMat3::from_cols(DVec3::new(f.x, 0.0, 0.0), DVec3::new(0.0, f.y, 0.0), DVec3::new(m.x, m.y, 1.0));
            let (d, fisheye) = said.opencv_coefficients().ok_or_else(|| wrong("OpenCV", "another model", "one of OpenCV's"))?;
            let n = i + 1;
            let _ = write!(
                text,
                "camera{n}: \"{}\"\nimage_width{n}: {}\nimage_height{n}: {}\nfisheye{n}: {}\n",
                camera.name,
                said.size[0],
                said.size[1],
                u8::from(fisheye)
            );
            text.push_str(&matrix(&format!("M{n}"), 3, 3, &flat(&k[i])));
            text.push_str(&matrix(&format!("D{n}"), 1, d.len(), &d));
        }
        let (r, t, e, f) = stereo(&self.relative(b, a), k);
        text.push_str(&matrix("R", 3, 3, &flat(&r)));
        text.push_str(&matrix("T", 3, 1, &t.to_array()));
        text.push_str(&matrix("E", 3, 3, &flat(&e)));
        text.push_str(&matrix("F", 3, 3, &flat(&f)));
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_seen_by_two_cameras_obeys_essential_and_fundamental_matrix() {
        // The second camera 0.2 m to the right, a little ahead, turned to the left.
        let second = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.1), DVec3::new(0.2, 0.03, -0.05));
        let k = [900.0, 700.0].map(|f| DMat3::from_cols(DVec3::X * f, DVec3::Y * f, DVec3::new(320.0, 200.0, 1.0)));
        let (r, t, e, f) = stereo(&second.inverse(), k);
        for p in [DVec3::new(0.3, -0.2, -2.0), DVec3::new(-1.0, 0.5, -4.0)] {
            // In the axes of OpenCV; second by its own place, not by R and T.
            let x1 = FLIP * p;
            let x2 = FLIP * second.inverse().transform_point3(p);
            assert!((r * x1 + t - x2).length() < 1e-12);
            assert!(x2.dot(e * x1).abs() < 1e-12);
            let (p1, p2) = (k[0] * x1 / x1.z, k[1] * x2 / x2.z);
            // Pixels of some 1000 squared, F of norm 1, its rows of 1e-6 among them.
            assert!(p2.dot(f * p1).abs() < 1e-9 && (p2 + DVec3::Y).dot(f * p1).abs() > 1e-6);
        }
        // To the right of the first: OpenCV's T has a negative x.
        assert!(t.x < 0.0);
    }
}
