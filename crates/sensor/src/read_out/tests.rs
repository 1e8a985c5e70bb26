use super::*;
use diopter_light::cie::illuminant;

fn flat(sensor: &Sensor, electrons: f32, exposure_s: f64, size: [usize; 2]) -> FocalPlane {
    let facts = ExposureFacts { exposure_s, ..Default::default() };
    FocalPlane::even(sensor.bands(), &vec![electrons; sensor.cfa.channel_count()], size, facts)
}

fn read(sensor: &Sensor, plane: &FocalPlane, reading: &Reading) -> RawImage {
    read_out(plane, sensor, reading, &illuminant("D65").unwrap()).unwrap()
}

fn moments(values: &[u16]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().map(|d| *d as f64).sum::<f64>() / n;
    (mean, values.iter().map(|d| (*d as f64 - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

fn statistics(sensor: &Sensor, electrons: f32, iso: f64, seed: u64) -> (f64, f64) {
    moments(&read(sensor, &flat(sensor, electrons, 0.0, [200, 200]), &Reading::new(iso, seed)).mosaic.data)
}

fn plain(name: &str) -> Sensor {
    let mut s = Sensor::named(name).unwrap();
    (s.prnu, s.dsnu_e, s.dsnu_row_e, s.dsnu_column_e, s.hot_pixels.fraction) = (0.0, 0.0, 0.0, 0.0, 0.0);
    s.iso.iter_mut().for_each(|i| i.row_noise_e = 0.0);
    s
}

#[test]
fn photon_transfer_has_the_slope_of_the_gain() {
    // σ² = K²σ_d² + 1/12 + K (μ − μ_dark), EMVA 1288 eq. 12; 40 000 pixels give σ² within 0.7 %, tested at 4 σ.
    let sensor = plain("canon-5d-mark-iv");
    let step = sensor.at_iso(400.0).unwrap();
    let k = 1.0 / step.gain_e_per_dn;
    for electrons in [0.0f32, 3.0, 20.0, 900.0, 9000.0] {
        let (mean, variance) = statistics(&sensor, electrons, 400.0, 3);
        let expected = step.black_level_dn + k * electrons as f64;
        let sigma = (k * k * (step.read_noise_e.powi(2) + electrons as f64) + 1.0 / 12.0).sqrt();
        assert!((mean - expected).abs() < 4.5 * sigma / 200.0, "{electrons}: mean {mean} {expected}");
        assert!((variance / (sigma * sigma) - 1.0).abs() < 0.03, "{electrons}: variance {variance} {}", sigma * sigma);
    }
}

#[test]
fn the_full_well_clips_and_seeds_differ() {
    let sensor = plain("canon-5d-mark-iv");
    let (mean, variance) = statistics(&sensor, 1e9, 100.0, 1);
    assert!(variance < 60.0 && mean > 15_900.0, "{mean} {variance}");
    assert_ne!(statistics(&sensor, 100.0, 100.0, 1), statistics(&sensor, 100.0, 100.0, 2));
    assert_eq!(statistics(&sensor, 100.0, 100.0, 1), statistics(&sensor, 100.0, 100.0, 1));
}

#[test]
fn other_bands_are_refused() {
    let sensor = Sensor::named("ideal").unwrap();
    let mut plane = flat(&sensor, 1.0, 0.0, [2, 2]);
    plane.bands[0].name = "Y".into();
    let e = read_out(&plane, &sensor, &Reading::new(100.0, 1), &illuminant("D65").unwrap()).unwrap_err();
    assert!(e.to_string().contains("Y, G, B"), "{e}");
    plane.bands[0] = Band { name: "R".into(), unit: BandUnit::Radiance };
    let e = read_out(&plane, &sensor, &Reading::new(100.0, 1), &illuminant("D65").unwrap()).unwrap_err();
    assert!(e.to_string().contains("not electrons"), "{e}");
}

#[test]
fn fixed_patterns_belong_to_the_serial_number() {
    let mut sensor = plain("ideal");
    (sensor.prnu, sensor.dsnu_e) = (0.01, 5.0);
    sensor.iso.iter_mut().for_each(|i| i.black_level_dn = 1000.0);
    let with = |serial: &str, seed: u64, electrons: f32| {
        let reading = Reading { serial: serial.into(), ..Reading::new(100.0, seed) };
        read(&sensor, &flat(&sensor, electrons, 0.0, [100, 100]), &reading).mosaic.data
    };
    let correlation = |a: &[u16], b: &[u16]| {
        let ((ma, va), (mb, vb)) = (moments(a), moments(b));
        let sum: f64 = a.iter().zip(b).map(|(x, y)| (*x as f64 - ma) * (*y as f64 - mb)).sum();
        sum / (a.len() as f64 - 1.0) / (va * vb).sqrt()
    };
    // 40 000 e⁻: shot noise 200, PRNU 400; shared variance 400² of 400² + 200² is 0.8; 10 000 pixels give 0.01.
    let (a, b, c) = (with("A", 1, 4e4), with("A", 2, 4e4), with("B", 2, 4e4));
    assert!((correlation(&a, &b) - 0.8).abs() < 0.02, "{}", correlation(&a, &b));
    assert!(correlation(&a, &c).abs() < 0.05);
    // In the dark the offsets are all there is.
    let (a, b) = (with("A", 1, 0.0), with("A", 2, 0.0));
    assert_eq!(a, b);
    let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
    assert!((moments(&a).1.sqrt() * gain / 5.0 - 1.0).abs() < 0.04);
}

#[test]
fn darkness_leaks_with_time_and_temperature() {
    let mut sensor = plain("ideal");
    sensor.dark_current = crate::sensor::DarkCurrent { points: vec![[20.0, 100.0]], doubling_c: 6.0 };
    let mean = |seconds: f64, celsius: f64| {
        let reading = Reading { temperature_c: Some(celsius), ..Reading::new(100.0, 1) };
        let (mean, variance) = moments(&read(&sensor, &flat(&sensor, 0.0, seconds, [100, 100]), &reading).mosaic.data);
        let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
        (mean * gain, variance * gain * gain)
    };
    for (seconds, celsius, expected) in [(10.0, 20.0, 1000.0), (10.0, 26.0, 2000.0), (40.0, 14.0, 2000.0)] {
        let (e, v) = mean(seconds, celsius);
        assert!((e / expected - 1.0).abs() < 3e-3 && (v / expected - 1.0).abs() < 0.06, "{seconds} {celsius}: {e} {v}");
    }
    sensor.hot_pixels = crate::sensor::HotPixels { fraction: 0.01, factor: 50.0 };
    let raw = read(&sensor, &flat(&sensor, 0.0, 10.0, [200, 200]), &Reading::new(100.0, 1));
    let hot = raw.mosaic.data.iter().filter(|d| **d as f64 * 1.83111 > 1500.0).count() as f64 / 40_000.0;
    // Of an exponential of mean 50 · 1000 e⁻, 99 % are above 500.
    assert!((hot / 0.0099 - 1.0).abs() < 0.15, "{hot}");
}

#[test]
fn rows_that_are_open_longer_leak_longer() {
    let mut sensor = plain("ideal");
    sensor.dark_current = crate::sensor::DarkCurrent { points: vec![[20.0, 100.0]], doubling_c: 6.0 };
    let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
    let (n, exposure_s, read_s) = (100usize, 10.0, 40.0);
    // Reset all at once, read one after the other, from the bottom; and as columns.
    for (kind, reset_s, columns) in
        [("rolling", 0.0, false), ("rolling", 0.0, true), ("rolling", read_s, false), ("leaf", 0.0, false)]
    {
        let step = |s: f64| s / n as f64;
        let rows = RowTimes::running(true, n as f64, [0.0, step(reset_s)], [exposure_s, step(read_s)]).of_columns(columns);
        let mut plane = flat(&sensor, 0.0, exposure_s, [n, n]);
        plane.facts.shutter = Some(diopter_image::ShutterFacts { kind: kind.into(), rows, ..Default::default() });
        let reading = Reading { temperature_c: Some(20.0), ..Reading::new(100.0, 1) };
        let raw = read(&sensor, &plane, &reading);
        let electrons = |line: usize| {
            let at = |i: usize| if columns { i * n + line } else { line * n + i };
            (0..n).map(|i| f64::from(raw.mosaic.data[at(i)])).sum::<f64>() / n as f64 * gain
        };
        let longer = if kind == "rolling" && reset_s == 0.0 { read_s } else { 0.0 };
        for line in [0, 50, 99] {
            // 100 e⁻/s; the last line is read first. 100 pixels of 1000 to 5000 e⁻ give 0.3 % and less.
            let expected = 100.0 * (exposure_s + longer * (n - 1 - line) as f64 / n as f64);
            assert!((electrons(line) / expected - 1.0).abs() < 0.02, "{kind} {line}: {} {expected}", electrons(line));
        }
        let reader = ReadOut::new(&sensor, &reading, [n, n], &plane.bands, exposure_s).unwrap().with_rows_of(&plane.facts);
        let told = f64::from(reader.expected(&Window { first: 0, data: &plane.mean.data }, 0)[0].dark);
        assert!((told / (100.0 * (exposure_s + longer * 0.99)) - 1.0).abs() < 1e-5, "{told}");
    }
}

#[test]
fn crosstalk_reaches_the_neighbours_and_keeps_the_sum() {
    let mut sensor = plain("ideal");
    sensor.crosstalk = 0.05;
    let mut plane = flat(&sensor, 0.0, 0.0, [9, 9]);
    plane.mean.pixel_mut(4, 4).fill(1e5);
    let reader = ReadOut::new(&sensor, &Reading::new(100.0, 1), [9, 9], &plane.bands, plane.facts.exposure_s).unwrap();
    let row = |r: usize| reader.expected(&Window { first: 0, data: &plane.mean.data }, r);
    assert_eq!([row(4)[4], row(4)[5], row(3)[4], row(3)[3]].map(|e| e.electrons.round()), [80_000.0, 5000.0, 5000.0, 0.0]);
}

#[test]
fn in_full_color_every_pixel_has_the_noise_of_a_photosite_of_each_channel() {
    let sensor = plain("canon-5d-mark-iv");
    let facts = ExposureFacts { exposure_s: 0.0, ..Default::default() };
    let plane = FocalPlane::even(sensor.bands(), &[300.0, 2000.0, 900.0], [150, 100], facts);
    let raw = read(&sensor, &plane, &Reading { color_sampling: ColorSampling::Full, ..Reading::new(400.0, 3) });
    assert!(raw.header.cfa.has_all_channels() && raw.size() == [150, 100]);
    let step = sensor.at_iso(400.0).unwrap();
    let k = 1.0 / step.gain_e_per_dn;
    for (channel, electrons) in [300.0, 2000.0, 900.0].into_iter().enumerate() {
        let values: Vec<u16> = raw.mosaic.data.iter().skip(channel).step_by(3).copied().collect();
        let (mean, variance) = moments(&values);
        let expected = k * k * (electrons + step.read_noise_e.powi(2)) + 1.0 / 12.0;
        // 15 000 pixels give a variance within 1.2 %, tested at 4 σ.
        assert!((mean - step.black_level_dn - k * electrons).abs() < 4.0 * (expected / 15_000.0).sqrt(), "{channel}: {mean}");
        assert!((variance / expected - 1.0).abs() < 0.05, "{channel}: {variance} {expected}");
    }
    // The noise of one channel says nothing of that of another.
    let (red, green): (Vec<f64>, Vec<f64>) = raw.mosaic.data.chunks(3).map(|p| (f64::from(p[0]), f64::from(p[1]))).unzip();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (mr, mg) = (mean(&red), mean(&green));
    let product = |a: &[f64], ma: f64, b: &[f64], mb: f64| a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>();
    let correlation = product(&red, mr, &green, mg) / (product(&red, mr, &red, mr) * product(&green, mg, &green, mg)).sqrt();
    assert!(correlation.abs() < 0.035, "{correlation}");
}

#[test]
fn in_full_color_crosstalk_mixes_channels_as_in_the_mosaic() {
    for pattern in ["RG/GB", "quad", "x-trans"] {
        let mut sensor = plain("canon-5d-mark-iv");
        (sensor.crosstalk, sensor.cfa) = (0.04, Cfa::parse(pattern).unwrap());
        let alone = [1000.0, 5000.0, 2000.0];
        let plane = FocalPlane::even(sensor.bands(), &alone.map(|e| e as f32), [12, 12], ExposureFacts::default());
        let reading = Reading { color_sampling: ColorSampling::Full, ..Reading::new(100.0, 1) };
        let reader = ReadOut::new(&sensor, &reading, [12, 12], &plane.bands, 0.0).unwrap();
        let window = Window { first: 0, data: &plane.mean.data };
        let row = reader.expected(&window, 5);
        let mixed = sensor.mixed_by_crosstalk(&alone);
        for (channel, expected) in mixed.iter().enumerate() {
            for pixel in row.chunks(3) {
                assert!((f64::from(pixel[channel].electrons) / expected - 1.0).abs() < 1e-6, "{pattern} {channel}");
            }
        }
    }
    // Of a single lit pixel its neighbours get what leaks, the whole is kept.
    let mut sensor = plain("canon-5d-mark-iv");
    sensor.crosstalk = 0.04;
    let mut plane = flat(&sensor, 0.0, 0.0, [9, 9]);
    plane.mean.pixel_mut(4, 4).copy_from_slice(&[0.0, 1e4, 0.0]);
    let reading = Reading { color_sampling: ColorSampling::Full, ..Reading::new(100.0, 1) };
    let reader = ReadOut::new(&sensor, &reading, [9, 9], &plane.bands, 0.0).unwrap();
    let all: f64 = (0..9).flat_map(|r| reader.through_filters(&Window { first: 0, data: &plane.mean.data }, r)).sum();
    // Green leaks to red and blue, of which there is half as much; those leak nothing back: 1 − 4 f of green, 4 f of it to each of red and blue.
    assert!((all / 1e4 - (1.0 - 0.16 + 2.0 * 0.16)).abs() < 1e-9, "{all}");
}

#[test]
fn full_color_is_for_red_green_and_blue() {
    let sensor = Sensor::named("imx249").unwrap();
    let reading = Reading { color_sampling: ColorSampling::Full, ..Reading::new(sensor.iso[0].iso, 1) };
    let e = read_out(&flat(&sensor, 1.0, 0.0, [2, 2]), &sensor, &reading, &illuminant("D65").unwrap()).unwrap_err();
    assert!(e.to_string().contains("full") && e.to_string().contains("red, green and blue"), "{e}");
}

#[test]
fn wells_bloom_along_the_column_only_when_asked() {
    let mut sensor = plain("ideal");
    sensor.full_well_e = 1000.0;
    let mut plane = flat(&sensor, 0.0, 0.0, [5, 21]);
    plane.mean.pixel_mut(2, 10).fill(5000.0);
    let lit = |s: &Sensor| {
        let raw = read(s, &plane, &Reading::new(100.0, 1)).mosaic;
        (0..21).filter(|r| raw.pixel(2, *r)[0] > 0).count()
    };
    assert_eq!(lit(&sensor), 1);
    sensor.blooming = true;
    assert_eq!(lit(&sensor), 5, "5000 e- fill five wells of 1000");
}

#[test]
fn two_readings_see_what_one_cannot() {
    let mut sensor = plain("ideal");
    sensor.full_well_e = 10_000.0;
    sensor.iso.iter_mut().for_each(|i| i.black_level_dn = 100.0);
    sensor.second_reading =
        Some(SecondReading { relative_exposure: 0.1, full_well_e: 9000.0, read_noise_e: 3.0, switch_at: 0.9 });
    let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
    // Of the second: a tenth of the photons, ten times the electrons: variance 10 µ + (3 · 10)². 40 000 pixels: 0.7 %.
    for (electrons, expected) in [(1000.0f32, 1000.0), (60_000.0, 60_000.0 * 10.0 + 900.0)] {
        let (mean, variance) = statistics(&sensor, electrons, 100.0, 1);
        let (mean, variance) = ((mean - 100.0) * gain, variance * gain * gain);
        assert!((mean / electrons as f64 - 1.0).abs() < 0.01, "{electrons}: {mean}");
        assert!((variance / expected - 1.0).abs() < 0.03, "{electrons}: {variance} {expected}");
    }
    assert!(sensor.saturation_e(&sensor.at_iso(100.0).unwrap()) > 85_000.0);
}

#[test]
fn full_pixels_are_white_in_every_body() {
    for name in Sensor::names() {
        let sensor = Sensor::named(name).unwrap();
        for step in &sensor.iso {
            let full = sensor.saturation_e(step);
            let white = |electrons: f64| {
                let raw = read(&sensor, &flat(&sensor, electrons as f32, 0.001, [60, 60]), &Reading::new(step.iso, 1));
                let n = raw.mosaic.data.iter().filter(|d| f64::from(**d) >= raw.header.white_level).count();
                n as f64 / raw.mosaic.data.len() as f64
            };
            assert!(white(2.0 * full) > 0.99, "{name} ISO {}: {}", step.iso, white(2.0 * full));
            assert!(white(0.8 * full) < 0.1, "{name} ISO {}: {}", step.iso, white(0.8 * full));
        }
    }
}

#[test]
fn what_is_expected_is_what_is_seen() {
    // Mean and variance of 200 read-outs of each pixel over what was expected of it, over a ramp up to twice the well.
    let mut sensor = Sensor::named("canon-t2i").unwrap();
    (sensor.crosstalk, sensor.dsnu_e) = (0.02, 20.0);
    let size = [64, 16];
    let mut plane = flat(&sensor, 0.0, 10.0, size);
    plane.mean.data.iter_mut().enumerate().for_each(|(i, v)| *v = 60_000.0 * ((i / 3 % 64) as f32 / 63.0).powi(3));
    let reading = |seed| Reading { temperature_c: Some(30.0), ..Reading::new(100.0, seed) };
    let reader = ReadOut::new(&sensor, &reading(1), size, &plane.bands, plane.facts.exposure_s).unwrap();
    let expected: Vec<Expected> =
        (0..16).flat_map(|r| reader.expected(&Window { first: 0, data: &plane.mean.data }, r)).collect();
    let (mut sums, mut squares) = (vec![0.0; 1024], vec![0.0; 1024]);
    const SHOTS: u64 = 200;
    for seed in 0..SHOTS {
        for ((s, q), dn) in sums.iter_mut().zip(&mut squares).zip(&read(&sensor, &plane, &reading(seed)).mosaic.data) {
            *s += f64::from(*dn);
            *q += f64::from(*dn).powi(2);
        }
    }
    let n = SHOTS as f64;
    let gain = sensor.at_iso(100.0).unwrap().gain_e_per_dn;
    let (mut chi2, mut ratio, mut used) = (0.0, 0.0, 0.0);
    for (i, e) in expected.iter().enumerate() {
        let (mean, variance) = (sums[i] / n, (squares[i] - sums[i] * sums[i] / n) / (n - 1.0));
        let claimed = f64::from(e.variance) / (gain * gain);
        let edge = (f64::from(e.electrons + e.dark) / 25_539.0 - 1.0).abs() < 0.05;
        if e.clipped && !edge {
            assert!(variance == 0.0 && (mean - f64::from(e.dn)).abs() < 1e-9, "{i}: {mean} {variance} {e:?}");
        } else if !edge {
            chi2 += (mean - f64::from(e.dn)).powi(2) / (claimed / n);
            ratio += variance / claimed;
            used += 1.0;
        }
    }
    // Row noise is shared by 64 pixels, and is a tenth of the variance at most in the dark.
    assert!((chi2 / used - 1.0).abs() < 0.25 && (ratio / used - 1.0).abs() < 0.02, "{} {}", chi2 / used, ratio / used);
}

#[test]
fn endless_light_fills_and_nonsense_is_dark() {
    let sensor = Sensor::named("canon-t2i").unwrap();
    let mut plane = flat(&sensor, f32::INFINITY, 0.001, [8, 8]);
    let top = read(&sensor, &plane, &Reading::new(100.0, 1));
    assert!(top.mosaic.data.iter().all(|d| f64::from(*d) >= top.header.white_level));
    plane.mean.data.fill(f32::NAN);
    let nothing = read(&sensor, &plane, &Reading::new(100.0, 1));
    assert!(nothing.mosaic.data.iter().all(|d| d.abs_diff(2048) < 60));
}

#[test]
fn rows_read_apart_are_the_whole() {
    let mut sensor = Sensor::named("canon-t2i").unwrap();
    sensor.crosstalk = 0.02;
    let mut plane = flat(&sensor, 500.0, 1.0, [64, 48]);
    plane.mean.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 977) as f32);
    let whole = read(&sensor, &plane, &Reading::new(200.0, 7)).mosaic.data;
    let reader = ReadOut::new(&sensor, &Reading::new(200.0, 7), [64, 48], &plane.bands, plane.facts.exposure_s).unwrap();
    let mut part = vec![0u16; 64 * 10];
    let window = Window { first: 19, data: &plane.mean.data[19 * 64 * 3..31 * 64 * 3] };
    reader.rows(&window, 20, &mut part);
    assert_eq!(part, whole[20 * 64..30 * 64]);
}

#[test]
fn digital_gain_leaves_gaps_between_the_numbers() {
    let mut sensor = plain("canon-5d-mark-iv");
    let last = sensor.iso.last_mut().unwrap();
    last.digital_gain = 4.0;
    let iso = last.iso;
    let raw = read(&sensor, &flat(&sensor, 100.0, 0.0, [50, 50]), &Reading::new(iso, 1));
    let black = sensor.iso.last().unwrap().black_level_dn as u16;
    assert!(raw.mosaic.data.iter().all(|d| d.abs_diff(black) % 4 == 0));
}
