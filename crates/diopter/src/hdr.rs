//! An exposure series into one raw image of more range.
//!
//! Each pixel becomes the mean of what the pictures say about the light there, weighted by how sure each is: one over the variance
//! that its noise profile gives for the light found (two rounds). Pixels near saturation say nothing, unless no picture holds more.
//! Source: Granados et al. 2010, "Optimal HDR Reconstruction with Linear Digital Cameras" (CVPR). Pictures are not aligned.
//!
//! The result is a mosaic of 16 bits whose white is the saturation of the shortest exposure: one step is 1/64 512 of that. Over long series steps are coarser than
//! the noise of the longest exposure: numbers are rounded up or down by chance, so that means stay what they are (non-subtractive dither, Lipshitz, Wannamaker &
//! Vanderkooy 1992), and the noise profile says what that costs.

use diopter_image::{ExposureFacts, MergedFacts, Raster, RawImage};
use diopter_light::random::{mix, to_unit};

/// Fraction of the range above which a pixel counts as full.
const FULL: f32 = 0.95;
/// Numbers of no light and of saturation.
const BLACK: f64 = 1023.0;
const WHITE: f64 = 65_535.0;

/// Why pictures cannot be merged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("picture {number}: {found}; expected {expected}")]
pub struct HdrError {
    /// Which, from 1.
    pub number: usize,
    /// What is odd.
    pub found: String,
    /// What would fit.
    pub expected: String,
}

/// Light on the film that a picture had beside another: time / T-stop², filter included; of one that was merged of several, what its numbers stand for.
fn light(raw: &RawImage) -> f64 {
    let f = &raw.header.facts;
    let stop = match (f.t_number > 0.0, f.f_number > 0.0) {
        (true, _) => f.t_number,
        (false, true) => f.f_number,
        _ => 1.0,
    };
    let time = f.shutter.as_ref().map_or(f.exposure_s, |s| s.effective_s);
    time / (stop * stop) * (-f.nd_stops).exp2() * f.merged.map_or(1.0, |merged| merged.scale)
}

/// Light that a picture's numbers stand for beside another's, by the electrons that saturate a pixel: those of its noise profile where all pictures have one, else by the ISO speed, which cameras keep to within a tenth or two.
fn exposures(raws: &[RawImage]) -> Vec<f64> {
    let same_speed = raws.iter().all(|raw| raw.header.facts.iso == raws[0].header.facts.iso);
    let of_noise = |raw: &RawImage| {
        let all = &raw.header.noise;
        let mean = all.iter().map(|noise| noise[0]).sum::<f64>() / all.len() as f64;
        // What is a mean of several has less noise than its electrons: beside it the ISO speed tells.
        (mean > 0.0 && raw.header.facts.merged.is_none()).then_some(mean)
    };
    let gains = if same_speed { None } else { raws.iter().map(of_noise).collect::<Option<Vec<f64>>>() };
    let gains = gains.unwrap_or_else(|| raws.iter().map(|raw| raw.header.facts.iso.max(1.0)).collect());
    raws.iter().zip(gains).map(|(raw, gain)| light(raw) * gain).collect()
}

/// Exposure, in the unit of those of a series, of which the merged picture has the brightness: of a bracket its middle, which is as the camera was set; of exposures whose rows are read in turn, which overlap
/// in time, the longest.
fn meant_exposure(raws: &[RawImage], exposures: &[f64]) -> f64 {
    let begun_and_ended = |raw: &RawImage| {
        let f = &raw.header.facts;
        f.shutter.as_ref().map(|shutter| [f.at_s, f.at_s + shutter.total_s])
    };
    let overlap = raws.windows(2).all(|pair| match [begun_and_ended(&pair[0]), begun_and_ended(&pair[1])] {
        [Some(a), Some(b)] => a[0] != b[0] && a[0].max(b[0]) < a[1].min(b[1]) * (1.0 - 1e-9),
        _ => false,
    });
    match overlap && raws.len() > 1 {
        true => exposures.iter().copied().fold(0.0, f64::max),
        false => (exposures.iter().map(|e| e.ln()).sum::<f64>() / exposures.len() as f64).exp(),
    }
}

/// How many EV more range the merged picture has than the best of its pictures, from the noise of no light to saturation, by their noise profiles; `None` where one has none.
pub fn extra_range_ev(raws: &[RawImage], merged: &RawImage) -> Option<f64> {
    let floor = |raw: &RawImage| raw.header.noise.iter().map(|noise| noise[1]).reduce(f64::max).filter(|v| *v > 0.0);
    let best = raws.iter().map(floor).collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::min)?;
    Some(0.5 * (best / floor(merged)?).log2())
}

/// How much longer than the mean a pixel was open: rows of a shutter with a reset of all at once are not open for the same time.
fn share_of_time(raw: &RawImage, column: usize, row: usize) -> f64 {
    // What is merged says what all of its pixels saw in the same time.
    if raw.header.facts.merged.is_some() {
        return 1.0;
    }
    let Some(s) = raw.header.facts.shutter.as_ref().filter(|s| s.effective_s > 0.0 && s.kind == "rolling") else { return 1.0 };
    let (open, close) = s.rows.of(if s.rows.columns { column } else { row });
    ((close - open) / s.effective_s).max(1e-6)
}

/// Noise (variance = a signal + b) of the mean where all pictures hold, which is in the shadows; exact where either part dominates. Lights that only shorter pictures
/// hold have more. Of each picture: factor on its signal, and its noise.
fn noise_of_mean(parts: impl Iterator<Item = (f32, [f32; 2])>) -> [f64; 2] {
    let [mut shot, mut read] = [0.0, 0.0];
    for (scale, [a, b]) in parts {
        let scale = f64::from(scale);
        shot += 1.0 / (scale * f64::from(a));
        read += 1.0 / (scale * scale * f64::from(b));
    }
    // Mean over all places between two steps.
    let rounding = ((WHITE - BLACK) * (WHITE - BLACK) * 6.0).recip();
    [shot.recip(), read.recip() + rounding]
}

/// What tells that a picture shows other things than the first of a series, or otherwise, and what was expected. Files of other programs say their distances coarsely.
fn other_picture(facts: &ExposureFacts, first: &ExposureFacts) -> Option<(String, &'static str)> {
    let name = |name: &str| if name.is_empty() { "none".to_owned() } else { format!("\"{name}\"") };
    let known = |a: &str, b: &str| !a.is_empty() && !b.is_empty() && a != b;
    let apart = |a: f64, b: f64, most: f64| a > 0.0 && b > 0.0 && (a / b).ln().abs() > most;
    if known(&facts.scene, &first.scene) {
        return Some((format!("it shows {}", name(&facts.scene)), "the scene of the first"));
    }
    if known(&facts.lens, &first.lens) {
        return Some((format!("it was taken through {}", name(&facts.lens)), "the lens of the first"));
    }
    if apart(facts.focal_length_mm, first.focal_length_mm, 0.02) {
        return Some((format!("its focal length is {:.1} mm", facts.focal_length_mm), "that of the first"));
    }
    if facts.photodiodes != first.photodiodes {
        return Some((format!("it holds the photodiodes {}", name(&facts.photodiodes)), "those of the first"));
    }
    if facts.light_field != first.light_field {
        return Some(("it has other microlenses".into(), "those of the first, or none"));
    }
    let [focus, first_focus] = [facts, first].map(|f| f.focus_distance_m.unwrap_or(f64::INFINITY));
    let ours = !facts.scene.is_empty() && !first.scene.is_empty();
    let elsewhere = focus != first_focus && (1.0 / focus - 1.0 / first_focus).abs() > 0.02 * (1.0 / focus).max(1.0 / first_focus);
    (ours && elsewhere)
        .then(|| (format!("it is focused at {focus:.3} m"), "the focus of the first; `diopter stack` joins a focus series"))
}

/// Merges pictures of the same scene and camera that differ in exposure. Fails without a picture, where they differ in size, filters, body, lens, focus, microlenses or photodiodes, where a
/// flash was fired, and where an exposure is not known.
pub fn merge(raws: &[RawImage]) -> Result<RawImage, HdrError> {
    let error = |k: usize, found: String, expected: &str| HdrError { number: k + 1, found, expected: expected.into() };
    let Some(first) = raws.first() else { return Err(error(0, "there is none".into(), "at least one picture")) };
    let size = |r: &RawImage| [r.mosaic.width, r.mosaic.height];
    for (k, raw) in raws.iter().enumerate() {
        if size(raw) != size(first) {
            let found = format!("{} × {} pixels", raw.mosaic.width, raw.mosaic.height);
            return Err(error(k, found, "the size of the first"));
        }
        if raw.header.cfa != first.header.cfa || raw.header.facts.body != first.header.facts.body {
            return Err(error(k, format!("it was taken with \"{}\"", raw.header.facts.body), "the camera of the first"));
        }
        if let Some((what, expected)) = other_picture(&raw.header.facts, &first.header.facts) {
            return Err(error(k, what, expected));
        }
        if raw.header.facts.flash {
            return Err(error(k, "a flash was fired".into(), "light that lasts: a flash gives as much at any exposure time"));
        }
        if !(light(raw) > 0.0 && light(raw).is_finite()) {
            return Err(error(k, "its exposure time is not known".into(), "a file that says how it was exposed"));
        }
    }
    let exposures = exposures(raws);
    // The longest first.
    let mut order: Vec<(&RawImage, f64)> = raws.iter().zip(exposures.iter().copied()).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    let shortest = order[order.len() - 1].1;
    // A merged picture is brighter than its numbers are.
    let brightened = |raw: &RawImage| raw.header.facts.merged.map_or(0.0, |merged| merged.brightened_ev);
    let shown: Vec<f64> = raws.iter().zip(&exposures).map(|(raw, exposure)| exposure * brightened(raw).exp2()).collect();
    let meant = meant_exposure(raws, &shown);
    // The exposure that is told is the one nearest to its brightness.
    let off = |(raw, exposure): (&RawImage, f64)| (exposure * brightened(raw).exp2() / meant).ln().abs();
    let (told, told_exposure) = order
        .iter()
        .rev()
        .fold(order[order.len() - 1], |near, other| if off(*other) < off(near) * (1.0 - 1e-9) { *other } else { near });

    let channels = first.header.cfa.channel_count();
    // Of each picture: factor on its signal, and noise (a signal + b) for each channel.
    let noise = |raw: &RawImage, c: usize| raw.header.noise.get(c).copied().unwrap_or([1e-4, 1e-6]);
    let parts: Vec<(f32, Vec<[f32; 2]>)> = order
        .iter()
        .map(|(raw, exposure)| {
            let scale = (shortest / exposure) as f32;
            (scale, (0..channels).map(|c| noise(raw, c).map(|v| v as f32)).collect())
        })
        .collect();
    let order: Vec<&RawImage> = order.into_iter().map(|(raw, _)| raw).collect();
    let (width, height) = (first.mosaic.width, first.mosaic.height);
    // Linear pictures have three numbers a pixel.
    let numbers = first.header.cfa.samples_per_pixel();
    let mut mosaic = Raster::new(width, height, 1);
    for (i, to) in mosaic.data.iter_mut().enumerate() {
        let c = first.header.cfa.channel_at(i % width, i / width);
        // What a pixel of each picture says, and its factor: of the light that the shortest would have made of it.
        let signal = |k: usize| {
            let h = &order[k].header;
            ((f64::from(order[k].mosaic.data[i]) - h.black_level) / (h.white_level - h.black_level)) as f32
        };
        let scale_of = |k: usize| parts[k].0 / share_of_time(order[k], i % width / numbers, i / width) as f32;
        // What holds: from the first picture on that is not full; the shortest whatever it says.
        let holds = (0..order.len()).find(|k| signal(*k) < FULL).unwrap_or(order.len() - 1);
        let mut light = signal(holds) * scale_of(holds);
        for _ in 0..2 {
            let (mut sum, mut total) = (0.0, 0.0);
            for (k, (_, noise)) in parts.iter().enumerate().skip(holds) {
                let scale = scale_of(k);
                let expected = (light / scale).max(0.0);
                if expected > FULL && k + 1 < parts.len() {
                    continue;
                }
                let weight = 1.0 / (scale * scale * (noise[c][0] * expected + noise[c][1]).max(1e-12));
                sum += weight * signal(k) * scale;
                total += weight;
            }
            light = sum / total;
        }
        let chance = f64::from(to_unit(mix(mix(i as u32 ^ 0x51ab_3c17))));
        *to = (BLACK + f64::from(light) * (WHITE - BLACK) + chance).floor().clamp(0.0, WHITE) as u16;
    }
    let mut header = told.header.clone();
    let scale = told.header.facts.merged.map_or(1.0, |merged| merged.scale) * shortest / told_exposure;
    let brightened_ev = (meant / shortest).log2();
    header.facts.merged = Some(MergedFacts { scale, brightened_ev });
    header.noise = (0..channels).map(|c| noise_of_mean(parts.iter().map(|(scale, noise)| (*scale, noise[c])))).collect();
    (header.bits, header.black_level, header.white_level) = (16, BLACK, WHITE);
    header.baseline_ev += brightened_ev - brightened(told);
    Ok(RawImage { mosaic, header })
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::focal_plane::FocalPlane;
    use diopter_image::{Cfa, RowTimes, ShutterFacts};
    use diopter_sensor::{Reading, Sensor, read_out};

    /// Even fields of a light (electrons a second in every channel), each twice as long as the one before.
    fn series(sensor: &Sensor, electrons_s: f32, times: &[f64]) -> Vec<RawImage> {
        let white = diopter_light::cie::illuminant("D65").unwrap();
        times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let facts = ExposureFacts { exposure_s: *t, f_number: 4.0, body: sensor.name.clone(), ..Default::default() };
                let signal = vec![electrons_s * *t as f32; sensor.bands().len()];
                let plane = FocalPlane::even(sensor.bands(), &signal, [128, 128], facts);
                read_out(&plane, sensor, &Reading::new(100.0, k as u64), &white).unwrap()
            })
            .collect()
    }

    fn statistics(raw: &RawImage) -> (f64, f64) {
        let h = &raw.header;
        let v: Vec<f64> =
            raw.mosaic.data.iter().map(|d| (f64::from(*d) - h.black_level) / (h.white_level - h.black_level)).collect();
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        (mean, v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / v.len() as f64)
    }

    #[test]
    fn shadows_between_two_steps_keep_their_mean_and_the_range_is_that_of_the_noise() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        // Eight stops: one step is many electrons of the longest.
        let raws = series(&sensor, 300.0, &[0.001, 0.016, 0.256]);
        let merged = merge(&raws).unwrap();
        let (mean, variance) = statistics(&merged);
        let (longest, _) = statistics(&raws[2]);
        let expected = longest / 256.0;
        let steps = 1.0 / (WHITE - BLACK);
        assert!(expected < 3.0 * steps && (mean / expected - 1.0).abs() < 0.02, "{mean} {expected}");
        let [shot, read] = merged.header.noise[1];
        // Of rounding at most 1/4 step², on the mean 1/6.
        assert!(variance < 1.6 * (shot * mean + read), "{variance} {shot} {read}");
        let gained = extra_range_ev(&raws, &merged).unwrap();
        assert!((2.0..6.0).contains(&gained), "{gained}");
    }

    #[test]
    fn a_series_holds_what_no_picture_holds() {
        let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
        let times = [0.0025, 0.01, 0.04];
        // From the shadows of the longest to the lights of the shortest.
        for electrons_s in [2e3f32, 4e4, 8e5, 8e6] {
            let raws = series(&sensor, electrons_s, &times);
            let merged = merge(&raws).unwrap();
            let (shortest, _) = statistics(&raws[0]);
            let (mean, variance) = statistics(&merged);
            // The shortest alone knows it less well; where it is the only one, it says it all.
            assert!((mean / shortest - 1.0).abs() < 0.05, "{electrons_s}: {mean} {shortest}");
            let alone = statistics(&raws[0]).1;
            assert!(variance < alone * 1.05, "{electrons_s}: {variance} {alone}");
            if electrons_s < 1e5 {
                assert!(variance < 0.2 * alone, "{electrons_s}: {variance} {alone}");
            }
        }
        assert!((merge(&series(&sensor, 1e4, &times)).unwrap().header.baseline_ev - raws_baseline(&sensor) - 2.0).abs() < 1e-9);
    }

    /// Stops by which the merged picture of a series is brightened over its shortest exposure.
    fn brightened(sensor: &Sensor, raws: &[RawImage]) -> f64 {
        merge(raws).unwrap().header.baseline_ev - raws_baseline(sensor)
    }

    #[test]
    fn the_merged_picture_is_as_bright_as_the_middle_of_a_bracket_and_as_the_longest_of_interleaved_exposures() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        for (times, expected) in [(&[0.01, 0.04][..], 1.0), (&[0.01, 0.04, 0.16, 0.64], 3.0), (&[0.01, 0.02, 0.04], 1.0)] {
            let mut raws = series(&sensor, 1e4, times);
            assert!((brightened(&sensor, &raws) - expected).abs() < 1e-9, "{times:?}");
            // One after the other, and, with rows that are read in turn, before the one before has ended.
            for (pause_s, expected) in [(0.0, expected), (-0.005, (times[times.len() - 1] / times[0]).log2())] {
                let mut at_s = 0.0;
                for (raw, time) in raws.iter_mut().zip(times).rev() {
                    let rows = RowTimes { open_s: [0.0; 2], close_s: [*time, 0.0], columns: false };
                    let (kind, total_s) = ("rolling".into(), time + 0.01);
                    raw.header.facts.shutter = Some(ShutterFacts { kind, total_s, effective_s: *time, rows });
                    raw.header.facts.at_s = at_s;
                    at_s += total_s + pause_s;
                }
                assert!((brightened(&sensor, &raws) - expected).abs() < 1e-9, "{times:?} {pause_s}");
            }
        }
    }

    #[test]
    fn what_is_merged_once_more_is_the_same_light() {
        let sensor = Sensor::named("nikon-d850").unwrap();
        let times = [0.0025, 0.01, 0.04];
        let raws = series(&sensor, 4e4, &times);
        let once = merge(&raws).unwrap();
        assert_eq!(once.header.facts.exposure_s, 0.01);
        let light =
            |raw: &RawImage| statistics(raw).0 / raw.header.facts.exposure_s / raw.header.facts.merged.map_or(1.0, |m| m.scale);
        assert!((light(&once) / light(&raws[2]) - 1.0).abs() < 0.01, "{} {}", light(&once), light(&raws[2]));
        for more in &raws {
            let again = merge(&[once.clone(), more.clone()]).unwrap();
            assert!((light(&again) / light(&once) - 1.0).abs() < 0.01, "{} {}", light(&again), light(&once));
        }
        // As bright as both, with the middle picture, in a developed picture.
        let brightness = |raw: &RawImage| statistics(raw).0 * raw.header.baseline_ev.exp2();
        let again = merge(&[once.clone(), raws[1].clone()]).unwrap();
        for one in [&raws[1], &once] {
            assert!((brightness(&again) / brightness(one) - 1.0).abs() < 0.01, "{} {}", brightness(&again), brightness(one));
        }
        assert_eq!(again.header.facts.exposure_s, 0.01);
        let refused = |change: &dyn Fn(&mut ExposureFacts)| {
            let mut raws = raws.clone();
            raws.iter_mut().for_each(|raw| (raw.header.facts.scene, raw.header.facts.lens) = ("a".into(), "l".into()));
            change(&mut raws[1].header.facts);
            merge(&raws).err().map(|e| e.to_string())
        };
        assert_eq!(refused(&|_| ()), None);
        for (told, change) in [
            ("it shows \"b\"", &(|f: &mut ExposureFacts| f.scene = "b".into()) as &dyn Fn(&mut ExposureFacts)),
            ("taken through \"m\"", &|f| f.lens = "m".into()),
            ("`diopter stack`", &|f| f.focus_distance_m = Some(1.0)),
            ("photodiodes \"left\"", &|f| f.photodiodes = "left".into()),
            ("other microlenses", &|f| f.light_field = Some(Default::default())),
        ] {
            let found = refused(change).unwrap_or_default();
            assert!(found.starts_with("picture 2") && found.contains(told), "{told}: {found}");
        }
    }

    #[test]
    fn pictures_of_several_iso_speeds_agree_by_the_electrons_that_saturate_them() {
        // From ISO 100 to 800 the range of its numbers changes, too: 8.9 times the signal.
        let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
        let low = series(&sensor, 2e4, &[0.04]).remove(0);
        let white = diopter_light::cie::illuminant("D65").unwrap();
        let facts = ExposureFacts { exposure_s: 0.04, f_number: 4.0, body: sensor.name.clone(), ..Default::default() };
        let plane = FocalPlane::even(sensor.bands(), &vec![800.0; sensor.bands().len()], [128, 128], facts);
        let high = read_out(&plane, &sensor, &Reading::new(800.0, 9), &white).unwrap();
        let (mean, _) = statistics(&merge(&[low.clone(), high.clone()]).unwrap());
        // In the unit of the picture that holds more light; most of what is known of it is from the other.
        let alone = statistics(&low).0;
        assert!((mean / alone - 1.0).abs() < 0.005, "{mean} {alone}");
        let ratio = statistics(&high).0 / alone;
        assert!((8.5..9.3).contains(&ratio), "{ratio}");
    }

    #[test]
    fn the_noise_profile_is_that_of_the_mean() {
        let sensor = Sensor::named("ideal").unwrap();
        // Frames of one exposure, as astronomers and phones stack them; a bracket whose pictures all hold.
        for times in [&[0.01; 4][..], &[0.01, 0.02, 0.04]] {
            for electrons_s in [2e4f32, 4e5] {
                let merged = merge(&series(&sensor, electrons_s, times)).unwrap();
                let (mean, variance) = statistics(&merged);
                let [a, b] = merged.header.noise[0];
                // 16 384 pixels know a variance within 1.1 %.
                assert!((variance / (a * mean + b) - 1.0).abs() < 0.05, "{times:?} {electrons_s}: {variance} {}", a * mean + b);
            }
        }
    }

    #[test]
    fn columns_that_are_open_longer_are_no_brighter_in_linear_pictures() {
        // A shutter that runs along columns and resets all at once: the last of 42 is open for 1.4 times the mean.
        let sensor = Sensor::named("canon-5d-mark-iv").unwrap();
        let raws: Vec<RawImage> = series(&sensor, 1e5, &[0.01, 0.01])
            .into_iter()
            .map(|raw| {
                let mut header = raw.header;
                header.cfa = Cfa::linear_rgb();
                let rows = RowTimes { open_s: [0.0; 2], close_s: [0.006, 0.008 / 41.0], columns: true };
                header.facts.shutter = Some(ShutterFacts { kind: "rolling".into(), total_s: 0.014, effective_s: 0.01, rows });
                let mut mosaic = Raster::new(126, 8, 1);
                for (i, to) in mosaic.data.iter_mut().enumerate() {
                    let time = rows.of(i % 126 / 3).1 / 0.01;
                    *to = (header.black_level + 0.3 * time * (header.white_level - header.black_level)).round() as u16;
                }
                RawImage { mosaic, header }
            })
            .collect();
        let merged = merge(&raws).unwrap();
        let range = merged.mosaic.data.iter().fold([u16::MAX, 0], |[a, b], v| [a.min(*v), b.max(*v)]);
        // A number of 14 bits is four of 16.
        assert!(range[1] - range[0] < 16 && f64::from(range[0]) > BLACK, "{range:?}");
    }

    fn raws_baseline(sensor: &Sensor) -> f64 {
        series(sensor, 1e4, &[0.01])[0].header.baseline_ev
    }

    #[test]
    fn pictures_that_do_not_belong_together_are_refused() {
        let (a, b) = (Sensor::named("canon-5d-mark-iv").unwrap(), Sensor::named("nikon-d850").unwrap());
        let mixed = [series(&a, 1e4, &[0.01]), series(&b, 1e4, &[0.02])].concat();
        assert!(merge(&mixed).unwrap_err().to_string().starts_with("picture 2: it was taken with"));
        assert!(merge(&[]).is_err());
    }
}
