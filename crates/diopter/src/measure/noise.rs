//! Photon transfer, from pairs of raw images of flat fields.
//!
//! Two pictures of the same exposure differ by temporal noise only: half of the variance of their difference (EMVA 1288 release 4.0, eqs. 12 and 13).
//! Photons that arrive independently have a variance equal to their mean: over pairs of several exposures the variance (DN²) rises with the mean
//! signal less black by the system gain K (DN/e⁻), from the variance of the read-out. Of one pair alone K is variance over signal, right where
//! photon noise outweighs the read-out's.
//!
//! The dark noise is what the line leaves at no light, less the variance of rounding (1/12 DN²); below 0.24 DN² rounding hides the noise (EMVA 1288, 4.0, clause on the
//! absolute sensitivity threshold). Where that leaves nothing, or the darkest pair lies below black, files are wrong about their black level: a pair that has next to no light then is taken for
//! dark. The dynamic range is that of the standard: white over the signal that equals the noise beside its own, √(σ_d² + σ_q²/K²) + ½ e⁻.
//!
//! `diopter_sensor::emva` measures bodies of our own, with exposures as the standard wants them; this here needs no more than files.

use super::fit::least_squares;
use super::{MeasureError, Region};
use diopter_image::RawImage;
use diopter_sensor::emva;
use serde::Serialize;

/// Fraction of the samples that may be clipped.
const MOST_CLIPPED: f64 = 0.001;
/// Exposures of a pair may differ by this fraction of their mean.
const MOST_DIFFERENCE: f64 = 0.05;
/// A pair of this fraction of the brightest one's signal may be dark.
const MOST_DARK: f64 = 0.02;

/// A pair of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// Mean signal less black, DN.
    pub signal_dn: f64,
    /// Temporal variance of one picture, DN².
    pub variance_dn2: f64,
    /// Signal over noise.
    pub snr: f64,
    /// Samples that were compared.
    pub samples: usize,
}

/// The photon transfer of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Transfer {
    /// Name of the channel: `R`, `G`, `B`, `W` or `Y`.
    pub channel: String,
    /// By rising signal.
    pub pairs: Vec<Pair>,
    /// System gain K, DN/e⁻.
    pub gain_dn_per_e: f64,
    /// Temporal dark noise, without that of rounding, e⁻, from where the fit meets no signal; `None` of pairs that do not tell (fewer than two different signals, or a line that meets no
    /// signal below 0, without a dark pair).
    pub dark_noise_e: Option<f64>,
    /// Level of the dark pair over the black level of the files, DN, where that is wrong.
    pub dark_offset_dn: Option<f64>,
    /// Signal at the white level, e⁻.
    pub white_e: f64,
    /// White over the absolute sensitivity threshold, stops; `None` without dark noise.
    pub dynamic_range_stops: Option<f64>,
}

/// Measures pairs of raw images, each pair of one exposure, within a region of the mosaic (the middle half without). Fails without a pair, on images of several cameras,
/// ISO speeds or sizes, on a region outside the mosaic or below 16 pixels a side, where pixels are clipped or a pair has two exposures, and where noise does not rise
/// with the light.
pub fn measure(pairs: &[(RawImage, RawImage)], region: Option<Region>) -> Result<Vec<Transfer>, MeasureError> {
    let Some((first, _)) = pairs.first() else {
        return Err(MeasureError::unfit("photon transfer", "no pictures", "two raw images of a flat field, or several pairs"));
    };
    let h = &first.header;
    let [width, height] = first.size();
    for (a, b) in pairs {
        for other in [a, b] {
            let o = &other.header;
            let levels = (o.white_level, o.black_level) == (h.white_level, h.black_level);
            let same = levels && other.size() == first.size() && o.cfa == h.cfa;
            let same = same && (&o.facts.body, o.facts.iso) == (&h.facts.body, h.facts.iso);
            if !same {
                return Err(MeasureError::unfit(
                    "photon transfer",
                    "pictures of different sizes, filters, levels, bodies or ISO speeds",
                    "raw images of one camera at one ISO speed",
                ));
            }
        }
    }
    let region = region.unwrap_or(Region { x: width / 4, y: height / 4, width: width / 2, height: height / 2 });
    let within = |at: usize, length: usize, all: usize| at.checked_add(length).is_some_and(|end| end <= all);
    let fits = within(region.x, region.width, width) && within(region.y, region.height, height);
    if !fits || region.width.min(region.height) < 16 {
        return Err(MeasureError::unfit(
            region.to_string(),
            format!("the mosaic has {width} × {height} pixels"),
            "x,y,width,height within it, at least 16 pixels a side",
        ));
    }
    let names = h.cfa.channel_names();
    let mut all = Vec::with_capacity(names.len());
    for (channel, name) in names.iter().enumerate() {
        let numbered = pairs.iter().zip(1..);
        let mut points = numbered
            .map(|((a, b), k)| pair(a, b, region, channel, &format!("{name}, pair {k}")))
            .collect::<Result<Vec<_>, _>>()?;
        points.sort_by(|a, b| a.signal_dn.total_cmp(&b.signal_dn));
        all.push(transfer(name, points, h.white_level - h.black_level)?);
    }
    Ok(all)
}

/// Mean and temporal variance of a channel in two pictures.
fn pair(a: &RawImage, b: &RawImage, r: Region, channel: usize, name: &str) -> Result<Pair, MeasureError> {
    let cfa = &a.header.cfa;
    let samples = cfa.samples_per_pixel();
    let (mut count, mut sums, mut difference, mut squares, mut clipped) = (0usize, [0.0; 2], 0.0, 0.0, 0usize);
    for row in r.y..r.y + r.height {
        for column in r.x * samples..(r.x + r.width) * samples {
            if cfa.channel_at(column, row) != channel {
                continue;
            }
            let i = row * a.mosaic.width + column;
            let v = [a.mosaic.data[i], b.mosaic.data[i]].map(f64::from);
            count += 1;
            clipped += usize::from(v.iter().any(|v| *v >= a.header.white_level || *v <= 0.0));
            let d = v[0] - v[1];
            (sums, difference, squares) = ([sums[0] + v[0], sums[1] + v[1]], difference + d, squares + d * d);
        }
    }
    let place = format!("photon transfer of {name}");
    let n = count as f64;
    if count < 100 {
        return Err(MeasureError::unfit(place, format!("{count} pixels"), "100 and more"));
    }
    if clipped as f64 > MOST_CLIPPED * n {
        let found = format!("{:.1} % of its pixels are clipped", 100.0 * clipped as f64 / n);
        return Err(MeasureError::unfit(place, found, "flat fields between black and white: expose them otherwise"));
    }
    let means = sums.map(|s| s / n - a.header.black_level);
    let signal_dn = 0.5 * (means[0] + means[1]);
    let variance_dn2 = 0.5 * (squares - difference * difference / n) / (n - 1.0);
    // Beyond what noise leaves of the means of darks.
    let sure = 6.0 * (2.0 * variance_dn2 / n).sqrt();
    if (means[0] - means[1]).abs() > MOST_DIFFERENCE * signal_dn.abs() + sure {
        let found = format!("means of {:.1} and {:.1} DN", means[0], means[1]);
        return Err(MeasureError::unfit(
            place,
            found,
            "two pictures of the same exposure in each pair (the same file order: A1 B1 A2 B2)",
        ));
    }
    let snr = signal_dn / variance_dn2.max(1e-12).sqrt();
    Ok(Pair { signal_dn, variance_dn2, snr, samples: count })
}

/// The line through pairs: variance = dark + K · signal.
fn transfer(name: &str, pairs: Vec<Pair>, white_dn: f64) -> Result<Transfer, MeasureError> {
    let place = format!("photon transfer of {name}");
    let brightest = pairs.iter().map(|p| p.signal_dn).fold(0.0, f64::max);
    if !(brightest > 0.0) || pairs.iter().all(|p| p.variance_dn2 == 0.0) {
        return Err(MeasureError::unfit(place, "no light or no noise", "raw images of an evenly lit field"));
    }
    let spread = brightest - pairs.iter().map(|p| p.signal_dn).fold(f64::MAX, f64::min);
    let (gain, dark) = if spread > 0.1 * brightest {
        // The error of a variance from n pairs of samples is √(2/n) of it: each is weighed by that.
        let rows = pairs.iter().map(|p| {
            let weight = (p.samples as f64 / 2.0).sqrt() / p.variance_dn2.max(1e-3);
            (vec![weight, weight * p.signal_dn / brightest], weight * p.variance_dn2)
        });
        let fit = least_squares(rows, 2);
        let Some(c) = fit else {
            return Err(MeasureError::unfit(place, "its pairs do not determine a line", "pairs of several exposures"));
        };
        (c[1] / brightest, Some(c[0]))
    } else {
        let [signal, variance] = pairs.iter().fold([0.0; 2], |s, p| [s[0] + p.signal_dn, s[1] + p.variance_dn2]);
        (variance / signal, None)
    };
    if !(gain > 0.0) {
        return Err(MeasureError::unfit(
            place,
            "noise that does not rise with the light",
            "raw images of flat fields, not denoised",
        ));
    }
    let darkest = &pairs[0];
    let below_black = darkest.signal_dn < -6.0 * (darkest.variance_dn2 / darkest.samples as f64).sqrt();
    let is_wrong = dark.is_some_and(|d| d <= 0.0 || below_black) && darkest.signal_dn < MOST_DARK * brightest;
    let dark_offset_dn = is_wrong.then_some(darkest.signal_dn);
    let dark = if is_wrong { Some(darkest.variance_dn2) } else { dark.filter(|d| *d > 0.0) };
    let white_e = (white_dn - dark_offset_dn.unwrap_or(0.0)) / gain;
    let dark_noise_e = dark.map(|d| emva::dark_noise_e(d, gain));
    let dynamic_range_stops = dark.map(|d| (white_e / emva::threshold_e(d, gain)).log2());
    Ok(Transfer { channel: name.into(), pairs, gain_dn_per_e: gain, dark_noise_e, dark_offset_dn, white_e, dynamic_range_stops })
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::{ExposureFacts, FocalPlane};
    use diopter_light::cie;
    use diopter_sensor::{Reading, Sensor, read_out};

    /// Pairs of even fields of a body at its lowest ISO speed.
    fn pairs(sensor: &Sensor, electrons: &[f32]) -> Vec<(RawImage, RawImage)> {
        let white = cie::illuminant("D65").unwrap();
        let iso = sensor.iso[0].iso;
        let shot = |e: f32, seed: u64| {
            let facts = ExposureFacts { exposure_s: 0.01, ..Default::default() };
            let bands = sensor.bands();
            let signal = vec![e; bands.len()];
            read_out(&FocalPlane::even(bands, &signal, [256, 256], facts), sensor, &Reading::new(iso, seed), &white).unwrap()
        };
        electrons.iter().zip(1..).map(|(e, k)| (shot(*e, 2 * k), shot(*e, 2 * k + 1))).collect()
    }

    #[test]
    fn gain_and_dark_noise_of_a_body_are_found_from_its_files() {
        for name in ["imx249", "canon-t2i"] {
            let sensor = Sensor::named(name).unwrap();
            let iso = sensor.at_iso(sensor.iso[0].iso).unwrap();
            let full = sensor.saturation_e(&iso) as f32;
            let fractions = [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
            let all = Region { x: 0, y: 0, width: 256, height: 256 };
            let found = measure(&pairs(&sensor, &fractions.map(|s| s * full)), Some(all)).unwrap();
            assert_eq!(found.len(), sensor.bands().len());
            for t in &found {
                let wanted = 1.0 / iso.gain_e_per_dn;
                // A variance from 16 384 pixels (a quarter of all) is sure to 1.1 %, the slope of the brighter seven to 0.5 %: 2 % are 4 of these.
                assert!((t.gain_dn_per_e / wanted - 1.0).abs() < 0.02, "{name} {}: {} {wanted}", t.channel, t.gain_dn_per_e);
                let dark = iso.read_noise_e.hypot(iso.row_noise_e);
                let measured = t.dark_noise_e.unwrap();
                assert!((measured / dark - 1.0).abs() < 0.1, "{name} {}: {measured} {dark}", t.channel);
                let threshold = (dark.powi(2) + iso.gain_e_per_dn.powi(2) / 12.0).sqrt() + 0.5;
                let stops = (f64::from(full) / threshold).log2();
                assert!((t.dynamic_range_stops.unwrap() - stops).abs() < 0.15, "{name} {}: {t:?} {stops}", t.channel);
                assert!(t.pairs.windows(2).all(|w| w[0].signal_dn <= w[1].signal_dn));
            }
        }
    }

    #[test]
    fn one_pair_tells_the_gain_alone() {
        let sensor = Sensor::named("imx249").unwrap();
        let iso = sensor.at_iso(sensor.iso[0].iso).unwrap();
        let half = 0.5 * sensor.saturation_e(&iso) as f32;
        let found = measure(&pairs(&sensor, &[half]), None).unwrap();
        let t = &found[0];
        // 16 384 pixels: 1.1 %; the read-out adds less than 0.5 % to the variance of half of the well.
        assert!((t.gain_dn_per_e * iso.gain_e_per_dn - 1.0).abs() < 0.035, "{}", t.gain_dn_per_e);
        assert_eq!((t.dark_noise_e, t.dynamic_range_stops), (None, None));
    }

    #[test]
    fn a_dark_pair_counts_where_files_are_wrong_about_their_black() {
        let sensor = Sensor::named("imx249").unwrap();
        let iso = sensor.at_iso(sensor.iso[0].iso).unwrap();
        let full = sensor.saturation_e(&iso) as f32;
        let dark = iso.read_noise_e.hypot(iso.row_noise_e);
        for off in [40.0, -40.0] {
            let mut all = pairs(&sensor, &[0.0, 0.1, 0.2, 0.4, 0.6].map(|s| s * full));
            for (a, b) in &mut all {
                a.header.black_level -= off;
                b.header.black_level -= off;
            }
            let t = &measure(&all, None).unwrap()[0];
            assert!((t.dark_noise_e.unwrap() / dark - 1.0).abs() < 0.1, "{off}: {t:?} {dark}");
            assert!((t.dark_offset_dn.unwrap() - off).abs() < 1.0, "{off}: {t:?}");
            // Without it nobody knows.
            let t = &measure(&all[1..], None).unwrap()[0];
            assert!(off < 0.0 || t.dark_noise_e.is_none(), "{off}: {t:?}");
        }
    }

    #[test]
    fn pictures_that_are_no_pairs_are_refused() {
        let sensor = Sensor::named("imx249").unwrap();
        let iso = sensor.at_iso(sensor.iso[0].iso).unwrap();
        let full = sensor.saturation_e(&iso) as f32;
        let told = |pairs: &[(RawImage, RawImage)]| measure(pairs, None).unwrap_err().to_string();
        assert!(told(&[]).contains("no pictures"));
        let mut bright = pairs(&sensor, &[0.5 * full]);
        let black = bright[0].0.header.black_level;
        (bright[0].0.header.white_level, bright[0].1.header.white_level) = (black + 10.0, black + 10.0);
        assert!(told(&bright).contains("clipped"));
        let mut two = pairs(&sensor, &[0.2 * full, 0.5 * full]);
        let (a, b) = (two.remove(0).0, two.remove(0).0);
        assert!(told(&[(a, b)]).contains("same exposure"));
    }
}
