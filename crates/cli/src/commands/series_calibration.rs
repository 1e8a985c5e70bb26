//! The calibration beside the pictures of `shoot`: one file for all of them, of the camera that took them.

use crate::watch::warn;
use diopter::calibration::{Calibration, CalibrationError, Format, ModelKind};
use diopter::shot::{Sequence, Shot};
use std::path::{Component, Path, PathBuf};

/// Error of a model from where it is told, pixels (rms).
const LARGE_ERROR_PX: f64 = 0.5;
/// Change of the extension from where on a picture has a camera of its own, mm: a thousandth of a pixel in the corner of the sharpest cameras.
const SAME_EXTENSION_MM: f64 = 1e-6;

/// What is known of the camera of a series.
pub struct SeriesCalibration {
    whole: Calibration,
    /// The files to write; with a calibration of its own where a format cannot say the model.
    files: Vec<(PathBuf, Format, Option<Calibration>)>,
    is_developed: bool,
    extension_mm: f64,
}

impl SeriesCalibration {
    /// Of the first picture. `is_developed`: whether the pictures are; else the files describe what the sensor takes. Fails on what a format cannot say, before the work.
    pub fn of(
        shot: &Shot,
        files: &[(PathBuf, Format)],
        picture: &str,
        is_developed: bool,
        sequence: &Sequence,
    ) -> Result<SeriesCalibration, CalibrationError> {
        let whole = shot.calibration_of(picture, is_developed, None)?;
        let refocuses = matches!(sequence, Sequence::Focus { count: 2.., .. });
        let mut all = Vec::with_capacity(files.len());
        for (path, format) in files {
            if refocuses && !format.holds_cameras() {
                return Err(CalibrationError {
                    what: path.display().to_string(),
                    found: "one camera for a focus series, each of whose pictures has a focal length of its own".into(),
                    expected: "a .json or transforms.json file, which hold a camera for each picture".into(),
                });
            }
            let own = match whole.text(*format) {
                Ok(_) => None,
                // A model that is the camera itself: fisheyes of one law can be said by a general one.
                Err(cannot) => match shot.calibration_of(picture, is_developed, Some(ModelKind::Fisheye)) {
                    Ok(fitted) if whole.fit.is_none() && fitted.text(*format).is_ok() => Some(fitted),
                    _ => return Err(cannot),
                },
            };
            let said = own.as_ref().unwrap_or(&whole);
            if let Some(fit) = said.fit.as_ref().filter(|fit| fit.rms_px > LARGE_ERROR_PX) {
                warn(&format!(
                    "{}: the model {} is {:.1} pixels off what the lens does (rms; {:.1} at most)",
                    path.display(),
                    said.model.kind().name(),
                    fit.rms_px,
                    fit.max_px
                ));
            }
            all.push((path.clone(), *format, own));
        }
        Ok(SeriesCalibration { whole, files: all, is_developed, extension_mm: shot.facts().extension_mm })
    }

    /// Adds the next picture. Fails where no model comes near a lens that was focused anew.
    pub fn add(&mut self, shot: &Shot, picture: &str) -> Result<(), CalibrationError> {
        let mut frame = shot.calibration_frame(picture);
        if (shot.facts().extension_mm - self.extension_mm).abs() > SAME_EXTENSION_MM {
            let kind = self.whole.fit.as_ref().map(|fit| fit.model.kind());
            let own = shot.calibration_of(picture, self.is_developed, kind)?;
            frame.camera = Some((own.model, own.focus_distance_m));
        }
        self.whole.frames.push(frame);
        Ok(())
    }

    /// The texts of the files, in which pictures are named as seen from the folder of each. Fails on what a format cannot say.
    pub fn texts(&self) -> Result<Vec<String>, CalibrationError> {
        let text = |(path, format, own): &(PathBuf, Format, Option<Calibration>)| {
            let mut said = own.as_ref().unwrap_or(&self.whole).clone();
            said.frames = self.whole.frames.clone();
            if (!format.holds_cameras() || own.is_some()) && said.frames.iter().any(|f| f.camera.is_some()) {
                warn(&format!("{}: it holds the camera of the first picture; others are focused elsewhere", path.display()));
                said.frames.iter_mut().for_each(|f| f.camera = None);
            }
            let folder = path.parent().unwrap_or(Path::new(""));
            said.frames.iter_mut().for_each(|f| f.picture = from_folder(Path::new(&f.picture), folder));
            said.text(*format)
        };
        self.files.iter().map(text).collect()
    }
}

/// A path as seen from a folder, with slashes: `../a/b.png`. Where there is no way from one to the other, as it is.
fn from_folder(path: &Path, folder: &Path) -> String {
    let absolute = |p: &Path| std::path::absolute(if p.as_os_str().is_empty() { Path::new(".") } else { p });
    let (Ok(to), Ok(from)) = (absolute(path), absolute(folder)) else { return path.display().to_string() };
    let parts = |p: &Path| -> Vec<String> {
        p.components().filter(|c| *c != Component::CurDir).map(|c| c.as_os_str().to_string_lossy().into_owned()).collect()
    };
    let (to, from) = (parts(&to), parts(&from));
    let shared = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return path.display().to_string();
    }
    let up = std::iter::repeat_n("..".to_owned(), from.len() - shared);
    up.chain(to[shared..].iter().cloned()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_named_from_the_folder_of_the_file() {
        for (path, folder, named) in [
            ("a.png", "", "a.png"),
            ("sub/dir/x.png", "sub", "dir/x.png"),
            ("sub/x.png", "sub/tr", "../x.png"),
            ("/data/x.png", "/data/out/a", "../../x.png"),
            ("./x.png", ".", "x.png"),
        ] {
            assert_eq!(from_folder(Path::new(path), Path::new(folder)), named, "{path} from {folder}");
        }
    }
}
