//! What a raw file says beside its pixels: calibrations, white, and how it was taken.

use super::super::parts::Storage;
use super::super::{XMP_NAMESPACE, tag};
use super::mosaic::flat;
use super::{DAYLIGHT_KELVIN, DAYLIGHT_XY, File, MADE_LEVELS, levels, malformed};
use crate::exif::EXIF_DIRECTORY;
use crate::raw::{self, Cfa, ColorCalibration, Framing, GREY_GAIN, LightSource, RawHeader};
use crate::{ExposureFacts, ImageError};
use diopter_light::color::kelvin_from_xy;
use std::io::{Read, Seek};
use tiff::Directory;

pub(super) fn header<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    raw: &Directory,
    cfa: Cfa,
    storage: &Storage,
    warnings: &mut Vec<String>,
) -> Result<RawHeader, ImageError> {
    let facts = facts(file, main)?;
    let polarizers = Cfa::parse(&facts.polarizers).filter(|p| cfa.is_monochrome() && p.tells_polarization());
    let cfa = polarizers.unwrap_or(cfa);
    let n = cfa.channel_count();
    let [black_level, white_level] = if storage.float { MADE_LEVELS } else { levels(file, raw, storage)? };
    let mut calibrations = Vec::new();
    if !cfa.is_colorless() {
        for k in 0..2 {
            let color = file.numbers(main, tag::COLOR_MATRIX[k])?;
            let forward = file.numbers(main, tag::FORWARD_MATRIX[k])?;
            if color.is_empty() {
                continue;
            }
            if color.len() != 3 * n || color.iter().chain(&forward).any(|v| !v.is_finite()) || flat(&color) {
                return Err(malformed(format!(
                    "ColorMatrix{} is no matrix of {n} × 3 numbers that tells colours apart: {color:?}",
                    k + 1
                )));
            }
            // Without one, colours come by the colour matrix.
            let mut columns: Vec<[f64; 3]> = match forward.len() == 3 * n {
                true => (0..n).map(|c| std::array::from_fn(|row| forward[row * n + c])).collect(),
                false => Vec::new(),
            };
            if !columns.is_empty() && flat(columns.as_flattened()) {
                warnings.push(format!("ForwardMatrix{} tells no colours apart: it is left out", k + 1));
                columns.clear();
            }
            let light = file.number(main, tag::CALIBRATION_ILLUMINANT[k])?.unwrap_or(0.0);
            let own = calibrated(file, main, k, n)?;
            let rows = color.as_chunks::<3>().0;
            let row = |c: usize| std::array::from_fn(|j| (0..n).map(|i| own[c * n + i] * rows[i][j]).sum());
            let camera_from_xyz: Vec<[f64; 3]> = (0..n).map(row).collect();
            if flat(camera_from_xyz.as_flattened()) {
                return Err(malformed(format!(
                    "CameraCalibration{} and AnalogBalance make ColorMatrix{} one that tells no colours apart: {own:?}",
                    k + 1,
                    k + 1
                )));
            }
            calibrations.push(ColorCalibration {
                light: LightSource(light as u16),
                camera_from_xyz,
                xyz_d50_from_balanced: columns,
            });
        }
        if calibrations.is_empty() {
            return Err(ImageError::Missing {
                what: "the tag ColorMatrix1".into(),
                hint: "without it colours cannot be made".into(),
            });
        }
    }
    let neutral = neutral(file, main, n, &calibrations, warnings)?;
    let largest = neutral.iter().fold(0.0f64, |a, b| a.max(*b));
    // Without it the fractions of saturation are meant as they are.
    let mut ev = |tag: u16| Ok::<_, ImageError>(file.number(main, tag)?.filter(|v| v.abs() <= 20.0).unwrap_or(0.0));
    // What the camera's profile adds, beside it.
    let baseline = ev(tag::BASELINE_EXPOSURE)? + ev(tag::BASELINE_EXPOSURE_OFFSET)?;
    let whites = file.numbers(raw, tag::WHITE_LEVEL)?;
    if whites.windows(2).any(|w| w[0] != w[1]) {
        warnings.push(format!("WhiteLevel differs between channels ({whites:?}): the first is taken for all"));
    }
    if file.numbers(raw, tag::DEFAULT_USER_CROP)?.iter().zip([0.0, 0.0, 1.0, 1.0]).any(|(found, whole)| *found != whole) {
        warnings.push("DefaultUserCrop: the whole picture is shown, not the part that was chosen in the camera".to_owned());
    }
    let planes = file.numbers(raw, tag::CFA_PLANE_COLOR)?;
    if planes.len() == 3 && planes != [0.0, 1.0, 2.0] && !cfa.is_colorless() {
        return Err(malformed(format!(
            "CFAPlaneColor is {planes:?}: expected red, green, blue (0, 1, 2), in which order matrices are read"
        )));
    }
    let noise = file.numbers(raw, tag::NOISE_PROFILE)?;
    // One pair stands for all planes.
    let noise = if noise.len() == 2 { noise.repeat(n) } else { noise };
    let fine = noise.len() == 2 * n && noise.iter().all(|v| v.is_finite() && *v >= 0.0);
    let noise = if fine { noise.as_chunks::<2>().0.to_vec() } else { Vec::new() };
    Ok(RawHeader {
        cfa,
        bits: if storage.float { 16 } else { storage.bits },
        black_level,
        white_level,
        as_shot_neutral: neutral.iter().map(|v| v / largest).collect(),
        calibrations,
        baseline_ev: baseline - GREY_GAIN.log2(),
        framing: Framing::default(),
        opcodes: Vec::new(),
        warnings: Vec::new(),
        noise,
        facts,
    })
}

/// What the body differs from its model: AnalogBalance · CameraCalibration, row by row; ones where the file does not tell.
pub(super) fn calibrated<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    k: usize,
    n: usize,
) -> Result<Vec<f64>, ImageError> {
    let own = file.numbers(main, tag::CAMERA_CALIBRATION[k])?;
    let balance = file.numbers(main, tag::ANALOG_BALANCE)?;
    let fine = |v: &[f64], length: usize| v.len() == length && v.iter().all(|x| x.is_finite());
    let balance = if fine(&balance, n) && balance.iter().all(|v| *v > 0.0) { balance } else { vec![1.0; n] };
    let unit = |i: usize| f64::from(u8::from(i / n == i % n));
    let own = if fine(&own, n * n) { own } else { (0..n * n).map(unit).collect() };
    Ok((0..n * n).map(|i| balance[i / n] * own[i]).collect())
}

/// Camera signals of white: told, or from its chromaticity, or of daylight, with a warning; all the same where there is no matrix.
pub(super) fn neutral<R: Read + Seek>(
    file: &mut File<R>,
    main: &Directory,
    n: usize,
    calibrations: &[ColorCalibration],
    warnings: &mut Vec<String>,
) -> Result<Vec<f64>, ImageError> {
    // No channel of a camera sees a millionth of another's white.
    let least = |v: &[f64]| 1e-6 * v.iter().fold(0.0f64, |a, b| a.max(*b));
    let fine = |v: &[f64]| v.len() == n && v.iter().all(|x| *x > least(v) && x.is_finite());
    let told = file.numbers(main, tag::AS_SHOT_NEUTRAL)?;
    if fine(&told) {
        return Ok(told);
    }
    if !told.is_empty() {
        return Err(malformed(format!("AsShotNeutral is {told:?}: expected {n} numbers above 0, none a millionth of another")));
    }
    // The calibration whose light is nearest to daylight.
    let off = |c: &ColorCalibration| c.light.kelvin().map_or(f64::MAX, |k| (1.0 / k - 1.0 / DAYLIGHT_KELVIN).abs());
    let Some(nearest) = calibrations.iter().min_by(|a, b| off(a).total_cmp(&off(b))) else { return Ok(vec![1.0; n]) };
    let signal = |camera_from_xyz: &[[f64; 3]], [x, y]: [f64; 2]| -> Vec<f64> {
        let xyz = [x / y, 1.0, (1.0 - x - y) / y];
        camera_from_xyz.iter().map(|row| row.iter().zip(xyz).map(|(a, b)| a * b).sum()).collect()
    };
    if let [x, y] = file.numbers(main, tag::AS_SHOT_WHITE_XY)?[..]
        && y > 0.0
        && let Some(rows) = raw::camera_from_xyz(calibrations, kelvin_from_xy((x, y)))
    {
        let signal = signal(&rows, [x, y]);
        if fine(&signal) {
            return Ok(signal);
        }
    }
    let daylight = signal(&nearest.camera_from_xyz, DAYLIGHT_XY);
    let told = "the file does not say what was white (AsShotNeutral)";
    if fine(&daylight) {
        warnings.push(format!("{told}: daylight was taken (D55, by its colour matrix); the setting white.balance takes another"));
        return Ok(daylight);
    }
    warnings.push(format!("{told}, and its colour matrix gives no white: all channels were taken alike"));
    Ok(vec![1.0; n])
}

/// The facts: our own as they were, others' from EXIF.
pub(super) fn facts<R: Read + Seek>(file: &mut File<R>, main: &Directory) -> Result<ExposureFacts, ImageError> {
    let packet: Vec<u8> = file.numbers(main, tag::XMP).unwrap_or_default().into_iter().map(|v| v as u8).collect();
    if let Some(facts) = our_facts(&String::from_utf8_lossy(&packet)) {
        return Ok(facts);
    }
    let place = file.number(main, EXIF_DIRECTORY)?;
    // EXIF that is damaged is no reason not to develop.
    let exif = place.and_then(|p| file.directory(p as u64).ok()).unwrap_or_else(Directory::empty);
    let mut number = |t: u16| file.number(&exif, t).ok().flatten().filter(|v| v.is_finite());
    let mut facts = ExposureFacts {
        exposure_s: number(33434).unwrap_or(0.0),
        f_number: number(33437).unwrap_or(0.0),
        iso: number(34867).or_else(|| number(34855)).unwrap_or(0.0),
        focal_length_mm: number(37386).unwrap_or(0.0),
        focal_length_35mm_mm: number(41989).unwrap_or(0.0),
        focus_distance_m: number(37382),
        light_scale: 1.0,
        ..Default::default()
    };
    facts.make = file.text(main, 271)?;
    facts.model = file.text(main, 272)?;
    facts.software = file.text(main, 305)?;
    facts.lens = file.text(&exif, 42036).unwrap_or_default();
    facts.date = Some(file.text(&exif, 36867).unwrap_or_default()).filter(|d| !d.is_empty());
    facts.body = facts.model.clone();
    Ok(facts)
}

pub(super) fn our_facts(packet: &str) -> Option<ExposureFacts> {
    packet.contains(XMP_NAMESPACE).then_some(())?;
    let escaped = packet.split_once("diopter:facts=\"")?.1.split_once('"')?.0;
    let json = escaped.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    serde_json::from_str(&json).ok()
}
