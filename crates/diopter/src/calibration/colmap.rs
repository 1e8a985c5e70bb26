//! COLMAP's text model: `cameras.txt` and `images.txt`.
//!
//! The centre of the upper left pixel is (0.5, 0.5). Poses are camera from world, axes as OpenCV's. Source: COLMAP documentation, "Output format" and src/colmap/sensor/models.h.

use super::camera_file::CameraFile;
use super::{Calibration, CalibrationError, CameraModel, ModelKind, numbers, wrong};
use glam::DVec2;

/// Half a pixel: COLMAP's corner is where ours is −0.5.
const HALF: DVec2 = DVec2::splat(0.5);

/// COLMAP's name of a model, whether it has one focal length, and how many coefficients.
const MODELS: [(&str, ModelKind, bool, usize); 11] = [
    ("SIMPLE_PINHOLE", ModelKind::Pinhole, true, 0),
    ("PINHOLE", ModelKind::Pinhole, false, 0),
    ("SIMPLE_RADIAL", ModelKind::SimpleRadial, true, 1),
    ("RADIAL", ModelKind::Radial, true, 2),
    ("OPENCV", ModelKind::OpenCv4, false, 4),
    ("FULL_OPENCV", ModelKind::OpenCv8, false, 8),
    ("OPENCV_FISHEYE", ModelKind::Fisheye, false, 4),
    ("THIN_PRISM_FISHEYE", ModelKind::ThinPrismFisheye, false, 8),
    ("SIMPLE_FISHEYE", ModelKind::Equidistant, true, 0),
    ("SIMPLE_DIVISION", ModelKind::Division, true, 1),
    ("DIVISION", ModelKind::Division, false, 1),
];

/// `cameras.txt` with one camera. Fails on a model that COLMAP does not have, such as opencv12 or double-sphere.
pub fn write_cameras(c: &Calibration) -> Result<String, CalibrationError> {
    let mut k = c.model.coefficients().to_vec();
    let (name, one) = match c.model.kind() {
        ModelKind::Pinhole => ("PINHOLE", false),
        ModelKind::SimpleRadial => ("SIMPLE_RADIAL", true),
        ModelKind::Radial => ("RADIAL", true),
        ModelKind::OpenCv4 => ("OPENCV", false),
        ModelKind::OpenCv5 | ModelKind::OpenCv8 => {
            k.resize(8, 0.0);
            ("FULL_OPENCV", false)
        }
        ModelKind::Fisheye | ModelKind::Equidistant => {
            k.resize(4, 0.0);
            ("OPENCV_FISHEYE", false)
        }
        ModelKind::ThinPrismFisheye => ("THIN_PRISM_FISHEYE", false),
        // From COLMAP 4 on.
        ModelKind::Division => ("DIVISION", false),
        _ => {
            let models = "pinhole, simple-radial, radial, opencv4, opencv5, opencv8, opencv-fisheye, thin-prism-fisheye, equidistant, division";
            return Err(c.cannot("COLMAP", models));
        }
    };
    let (f, m) = (c.model.focal(), c.model.centre() + HALF);
    let first = if one { vec![f.x, m.x, m.y] } else { vec![f.x, f.y, m.x, m.y] };
    let parameters = numbers(&[first, k].concat(), " ");
    let [width, height] = c.size;
    Ok(format!(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n\
         1 {name} {width} {height} {parameters}\n"
    ))
}

/// `images.txt`: the pose in the middle of each exposure, no points. Fails on a calibration without frames.
pub fn write_images(c: &Calibration) -> Result<String, CalibrationError> {
    if c.frames.is_empty() {
        return Err(wrong("images.txt", "a lens without pictures", "pictures: `shoot ... -o images.txt` writes their poses"));
    }
    let mut text = format!(
        "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
         #   POINTS2D[] as (X, Y, POINT3D_ID)\n# Number of images: {}, mean observations per image: 0\n",
        c.frames.len()
    );
    for (i, frame) in c.frames.iter().enumerate() {
        let Some(pose) = frame.middle() else { continue };
        let (q, t) = pose.opencv();
        let pose = numbers(&[q.w, q.x, q.y, q.z, t.x, t.y, t.z], " ");
        text.push_str(&format!("{} {pose} 1 {}\n\n", i + 1, frame.picture));
    }
    Ok(text)
}

/// Reads the first camera.
pub(super) fn read(text: &str, name: &str) -> Result<CameraFile, CalibrationError> {
    let line = text.lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#'));
    let words: Vec<&str> = line.unwrap_or("").split_whitespace().collect();
    let all = MODELS.map(|m| m.0).join(", ");
    let expected = || format!("a line \"CAMERA_ID MODEL WIDTH HEIGHT PARAMS\" of COLMAP with one of {all}");
    let Some((_, kind, one, count)) = words.get(1).and_then(|w| MODELS.iter().find(|m| m.0 == *w)) else {
        let found = line.map_or("no line of data".to_owned(), |l| format!("\"{}\"", l.chars().take(60).collect::<String>()));
        return Err(wrong(name, found, expected()));
    };
    let size = || Some([words.get(2)?.parse().ok()?, words.get(3)?.parse().ok()?]);
    let p: Option<Vec<f64>> = words[4.min(words.len())..].iter().map(|w| w.parse().ok()).collect();
    let wanted = count + if *one { 3 } else { 4 };
    let (Some(size), Some(mut p)) = (size(), p.filter(|p| p.len() == wanted)) else {
        return Err(wrong(name, format!("\"{}\"", words.join(" ")), format!("a size and {wanted} numbers after {}", words[1])));
    };
    if *one {
        p.insert(0, p[0]);
    }
    let model = CameraModel::new(*kind, DVec2::new(p[0], p[1]), DVec2::new(p[2], p[3]) - HALF, p[4..].to_vec())
        .map_err(|e| wrong(name, e.to_string(), "parameters of a camera"))?;
    Ok(CameraFile { size: Some(size), model, falloff: Vec::new(), film_mm: None })
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample;
    use super::*;

    #[test]
    fn pixels_count_from_the_corner() {
        let text = write_cameras(&sample(ModelKind::SimpleRadial)).unwrap();
        assert!(text.ends_with("\n1 SIMPLE_RADIAL 960 640 801.25 480.25 319.0 0.01\n"), "{text}");
        let read = read("# c\n2 RADIAL 10 20 5 5 10 -0.1 0.01\n", "x").unwrap();
        assert!(read.model.centre() == DVec2::new(4.5, 9.5) && read.model.focal() == DVec2::splat(5.0));
        let e = super::read("1 RADIAL 10 20 5 5\n", "x.txt").unwrap_err().to_string();
        assert!(e.contains("x.txt") && e.contains("5 numbers after RADIAL"), "{e}");
        assert!(super::read("1 FOV 10 20 5 5\n", "x.txt").is_err() && super::read("", "x").is_err());
    }

    #[test]
    fn poses_are_those_of_the_middle() {
        let text = write_images(&sample(ModelKind::OpenCv4)).unwrap();
        let line = text.lines().find(|l| l.starts_with("1 ")).unwrap();
        assert!(line.ends_with(" 1 a.jpg"), "{line}");
        assert_eq!(line.split(' ').count(), 10);
        let bare = Calibration { frames: Vec::new(), ..sample(ModelKind::OpenCv4) };
        assert!(write_images(&bare).unwrap_err().to_string().contains("shoot"));
    }
}
