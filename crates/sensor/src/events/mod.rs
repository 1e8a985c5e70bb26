//! Event sensors: each pixel reports by itself when the logarithm of its light has changed by a threshold.
//!
//! The pixel of Lichtsteiner, Posch & Delbruck 2008 (IEEE JSSC 43(2), 566): a logarithmic photoreceptor of finite bandwidth, a differencing amplifier that remembers the level of the last
//! event, two comparators, a reset that takes a refractory time. [`EventSensor`] is the data sheet, [`EventCamera`] the pixels at work, fed with photocurrents at moments that rise;
//! between them the logarithm of the current is linear. Light → log → low-pass → difference → events. What is left out: the read-out bus (no queues, no jitter of stamps),
//! parasitic photocurrents, thresholds that change with temperature.
//!
//! Units: photocurrent e⁻/s, levels and thresholds in natural logarithms, times s.

mod pixel;
mod sheet;

pub use sheet::{Bandwidth, EventSensor, ShotNoise};

use crate::SensorError;
use crate::noise::mix;
use pixel::Pixel;
use rayon::prelude::*;

/// A change of light at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// When, s on the clock of the light that was fed.
    pub time_s: f64,
    /// Column, from the left.
    pub x: u16,
    /// Row, from the top.
    pub y: u16,
    /// Brighter (ON) or darker (OFF).
    pub on: bool,
}

impl Event {
    /// Its stamp in whole microseconds since `origin_s`: the microsecond that it happened in.
    pub fn stamp_us(&self, origin_s: f64) -> i64 {
        ((self.time_s - origin_s) * 1e6).floor() as i64
    }
}

/// The pixels of an event sensor at work.
#[derive(Clone, Debug)]
pub struct EventCamera {
    sensor: EventSensor,
    width: usize,
    height: usize,
    /// `[row][column]`; empty before the first light.
    pixels: Vec<Pixel>,
    seed: u64,
    time_s: f64,
}

fn range(what: &str, found: impl ToString, expected: impl Into<String>) -> SensorError {
    SensorError::Range { what: what.into(), found: found.to_string(), expected: expected.into() }
}

impl EventCamera {
    /// Pixels of a sensor, `width` × `height` of them (a part of the sensor, or pixels binned otherwise, if these are not its own). All that is drawn by chance (mismatch, noise) follows
    /// from `seed`, pixel by pixel. Fails on sizes that stamps cannot hold: 1 to 65536 a side.
    pub fn new(sensor: EventSensor, [width, height]: [usize; 2], seed: u64) -> Result<Self, SensorError> {
        if !(1..=65_536).contains(&width) || !(1..=65_536).contains(&height) {
            return Err(range("size of the event sensor", format!("{width}x{height}"), "1 to 65536 pixels a side"));
        }
        Ok(EventCamera { sensor, width, height, pixels: Vec::new(), seed, time_s: f64::NEG_INFINITY })
    }

    /// The sheet.
    pub fn sensor(&self) -> &EventSensor {
        &self.sensor
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The moment of the last light, s; negative infinity before the first.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Feeds the photocurrents (e⁻/s, `[row][column]`, dark current not included) of a moment, s, and returns the events since the last one, in the order of their times (of the same time:
    /// by row, then column). The first light sets the levels that pixels remember, and gives no events.
    ///
    /// Fails on times that do not rise, and on currents that are negative, not finite or not one a pixel; the camera then is as it was.
    pub fn feed(&mut self, time_s: f64, current_e_s: &[f32]) -> Result<Vec<Event>, SensorError> {
        if current_e_s.len() != self.width * self.height {
            let expected = format!("{} ({} x {})", self.width * self.height, self.width, self.height);
            return Err(range("photocurrents", current_e_s.len(), expected));
        }
        if !(time_s > self.time_s && time_s.is_finite()) {
            return Err(range("time of the light", format!("{time_s} s"), format!("a time after {} s", self.time_s)));
        }
        if let Some(k) = current_e_s.iter().position(|c| !(c.is_finite() && *c >= 0.0)) {
            let place = format!("photocurrent of column {}, row {}", k % self.width, k / self.width);
            return Err(range(&place, current_e_s[k], "0 e-/s or more, finite"));
        }
        let level = |c: f32| (f64::from(c) + self.sensor.dark_e_s).ln();
        if self.pixels.is_empty() {
            let pixel = |(k, c): (usize, &f32)| Pixel::new(&self.sensor, mix(self.seed, k as u64), level(*c), time_s);
            self.pixels = current_e_s.par_iter().enumerate().map(pixel).collect();
            self.time_s = time_s;
            return Ok(Vec::new());
        }
        let (before, sensor, width) = (self.time_s, &self.sensor, self.width);
        let rows = self.pixels.par_chunks_mut(width).zip(current_e_s.par_chunks(width)).enumerate();
        let found: Vec<Vec<Event>> = rows
            .map(|(y, (pixels, currents))| {
                let mut events = Vec::new();
                for (x, (pixel, current)) in pixels.iter_mut().zip(currents).enumerate() {
                    let tell = |time_s: f64, on: bool| events.push(Event { time_s, x: x as u16, y: y as u16, on });
                    pixel.advance(sensor, before, time_s, level(*current), tell);
                }
                events
            })
            .collect();
        self.time_s = time_s;
        let mut events = found.concat();
        // Stable: events of a pixel at one time stay in their order.
        events.par_sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then((a.y, a.x).cmp(&(b.y, b.x))));
        Ok(events)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor without faults and a threshold of 0.25.
    fn plain() -> EventSensor {
        EventSensor { threshold_on: 0.25, threshold_off: 0.25, dark_e_s: 1.0, ..EventSensor::named("ideal-events").unwrap() }
    }

    fn camera(sensor: EventSensor, size: [usize; 2]) -> EventCamera {
        EventCamera::new(sensor, size, 7).unwrap()
    }

    /// The current whose logarithm, with the dark current of 1 e⁻/s, is this.
    fn current(level: f64) -> f32 {
        (level.exp() - 1.0) as f32
    }

    #[test]
    fn a_ramp_gives_as_many_events_as_thresholds_fit_into_it() {
        // Seven pixels, up and down by different amounts; thresholds of ON and OFF differ.
        let sensor = EventSensor { threshold_off: 0.4, ..plain() };
        let changes = [2.1, -2.1, 0.24, 0.26, -0.39, -0.41, 0.0];
        let mut camera = camera(sensor, [7, 1]);
        assert!(camera.feed(0.0, &[current(8.0); 7]).unwrap().is_empty());
        let mut events = Vec::new();
        for step in 1..=3 {
            let light = changes.map(|c| current(8.0 + c * f64::from(step) / 3.0));
            events.extend(camera.feed(f64::from(step) * 1e-3, &light).unwrap());
        }
        for (x, change) in changes.iter().enumerate() {
            let of: Vec<&Event> = events.iter().filter(|e| usize::from(e.x) == x).collect();
            let threshold: f64 = if *change > 0.0 { 0.25 } else { 0.4 };
            let expected = (change.abs() / threshold).floor() as usize;
            assert_eq!(of.len(), expected, "pixel {x}");
            assert!(of.iter().all(|e| e.on == (*change > 0.0)));
            // The k-th at k thresholds of a straight ramp of 3 ms. Currents are in single precision: 1e-7 of a level of 8.
            for (k, e) in of.iter().enumerate() {
                let due = 3e-3 * (k + 1) as f64 * threshold / change.abs();
                assert!((e.time_s - due).abs() < 1e-8, "pixel {x}, event {k}: {} for {due}", e.time_s);
            }
        }
        assert!(events.windows(2).all(|w| w[0].time_s <= w[1].time_s));
    }

    #[test]
    fn how_light_is_cut_into_steps_changes_nothing() {
        let sensor = EventSensor {
            refractory_s: 1e-4,
            leak_hz: 20.0,
            threshold_mismatch: 0.03,
            bandwidth: Some(Bandwidth { hz: 400.0, at_e_s: 3000.0, most_hz: 4e3 }),
            ..plain()
        };
        // The same straight ramps, fed at once and in ten steps. With a bandwidth that follows the light, steps do matter: here it is at its limit.
        let sensor =
            EventSensor { bandwidth: sensor.bandwidth.map(|b| Bandwidth { at_e_s: 1e-3, most_hz: b.hz, ..b }), ..sensor };
        let changes = [3.0, -3.0, 1.0, 0.0];
        let run = |steps: u32| {
            let mut camera = camera(sensor.clone(), [4, 1]);
            camera.feed(0.0, &[current(9.0); 4]).unwrap();
            let mut all = Vec::new();
            for k in 1..=steps {
                let f = f64::from(k) / f64::from(steps);
                all.extend(camera.feed(0.02 * f, &changes.map(|c| current(9.0 + c * f))).unwrap());
            }
            all
        };
        let (once, often) = (run(1), run(10));
        assert!(once.len() > 20 && once.len() == often.len(), "{} and {}", once.len(), often.len());
        for (a, b) in once.iter().zip(&often) {
            assert!((a.x, a.on) == (b.x, b.on) && (a.time_s - b.time_s).abs() < 1e-7, "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_refractory_pixel_forgets_what_it_sees_meanwhile() {
        // On a ramp of slope s, threshold θ: the next event θ / s after the pixel is free again.
        let mut camera = camera(EventSensor { refractory_s: 2e-3, ..plain() }, [1, 1]);
        camera.feed(0.0, &[current(5.0)]).unwrap();
        let mut events = Vec::new();
        for k in 1..=100 {
            // 100 per second: a threshold in 2.5 ms.
            events.extend(camera.feed(f64::from(k) * 1e-3, &[current(5.0 + 0.1 * f64::from(k))]).unwrap());
        }
        for (k, e) in events.iter().enumerate() {
            let due = 2.5e-3 + 4.5e-3 * k as f64;
            assert!((e.time_s - due).abs() < 1e-6, "{k}: {}", e.time_s);
        }
        assert_eq!(events.len(), ((0.1 - 2.5e-3) / 4.5e-3) as usize + 1);
    }

    #[test]
    fn leak_makes_on_events_at_its_rate() {
        let mut camera = camera(EventSensor { leak_hz: 5.0, threshold_mismatch: 0.03, ..plain() }, [40, 25]);
        let light = vec![current(6.0); 1000];
        camera.feed(0.0, &light).unwrap();
        let mut count = 0;
        for k in 1..=10 {
            let events = camera.feed(f64::from(k) * 0.2, &light).unwrap();
            assert!(events.iter().all(|e| e.on));
            count += events.len();
        }
        // Phases are spread evenly: each of 1000 pixels has exactly 5 Hz × 2 s events.
        assert_eq!(count, 10_000);
    }

    #[test]
    fn noise_comes_at_the_rate_that_the_light_gives() {
        let noise = ShotNoise { hz: 40.0, bright_e_s: 1000.0, bright_fraction: 0.25 };
        // Dark, halfway, bright and brighter: the rate falls to a quarter.
        for (light, rate) in [(0.0, 40.0), (499.0, 25.0), (999.0, 10.0), (1e6, 10.0)] {
            let sensor = EventSensor { shot_noise: Some(noise), ..plain() };
            let mut camera = camera(sensor, [50, 40]);
            let light = vec![light; 2000];
            camera.feed(0.0, &light).unwrap();
            let events: Vec<Event> = (1..=5).flat_map(|k| camera.feed(f64::from(k) * 0.1, &light).unwrap()).collect();
            let on = events.iter().filter(|e| e.on).count() as f64;
            // The dark current of 1 e⁻/s counts as light: 0.075 % of the rate at most.
            let mean = rate * 2000.0 * 0.5;
            assert!((events.len() as f64 - mean).abs() < 3.0 * mean.sqrt() + 1e-3 * mean, "{} for {mean}", events.len());
            assert!((on - 0.5 * mean).abs() < 3.0 * (0.5 * mean).sqrt() + 1e-3 * mean, "{on} ON for {}", 0.5 * mean);
        }
    }

    #[test]
    fn thresholds_differ_as_stated() {
        let sensor = EventSensor { threshold_mismatch: 0.02, ..plain() };
        let mut camera = camera(sensor, [200, 100]);
        camera.feed(0.0, &vec![current(5.0); 20_000]).unwrap();
        // A ramp of 1 per second: the first event of a pixel comes after its threshold in seconds.
        let events = camera.feed(0.4, &vec![current(5.4); 20_000]).unwrap();
        let mut first = vec![f64::NAN; 20_000];
        for e in events.iter().rev() {
            first[usize::from(e.y) * 200 + usize::from(e.x)] = e.time_s;
        }
        let n = first.len() as f64;
        let mean = first.iter().sum::<f64>() / n;
        let sd = (first.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / n).sqrt();
        // Three standard errors: 0.02 / √n of the mean, 0.02 / √(2 n) of the deviation.
        assert!((mean - 0.25).abs() < 3.0 * 0.02 / n.sqrt() && (sd - 0.02).abs() < 3.0 * 0.02 / (2.0 * n).sqrt(), "{mean} {sd}");
    }

    #[test]
    fn a_slow_photoreceptor_sees_a_step_as_an_exponential() {
        // A step of 2.1 in 1 ns through a pole at 100 Hz: level 2.1 (1 − e^(−t/τ)), event k at τ ln(2.1 / (2.1 − kθ)).
        let bandwidth = Bandwidth { hz: 100.0, at_e_s: 1e-6, most_hz: 100.0 };
        let mut camera = camera(EventSensor { bandwidth: Some(bandwidth), ..plain() }, [1, 1]);
        camera.feed(0.0, &[current(5.0)]).unwrap();
        let mut events = camera.feed(1e-9, &[current(7.1)]).unwrap();
        events.extend(camera.feed(0.1, &[current(7.1)]).unwrap());
        let tau = 1.0 / (std::f64::consts::TAU * 100.0);
        assert_eq!(events.len(), 8);
        for (k, e) in events.iter().enumerate() {
            let due = tau * (2.1 / (2.1 - 0.25 * (k + 1) as f64)).ln();
            // The step's own nanosecond, and currents in single precision near the end of the exponential.
            assert!((e.time_s - due).abs() < 2e-8, "{k}: {} for {due}", e.time_s);
        }
        // In the dark the pole follows the photocurrent: half of it, half the bandwidth.
        let b = Bandwidth { hz: 100.0, at_e_s: 1000.0, most_hz: 300.0 };
        assert_eq!([500.0, 1000.0, 2000.0, 1e5].map(|c| b.at(c)), [50.0, 100.0, 200.0, 300.0]);
    }

    #[test]
    fn the_same_seed_gives_the_same_events_for_any_number_of_threads() {
        let run = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut camera = EventCamera::new(EventSensor::named("davis346").unwrap(), [64, 48], seed).unwrap();
                let light = |k: u32| (0..64 * 48).map(|i| 3000.0 * (1.0 + ((i as u32 + 5 * k) % 64) as f32)).collect::<Vec<_>>();
                (0..6).flat_map(|k| camera.feed(f64::from(k) * 5e-3, &light(k)).unwrap()).collect::<Vec<_>>()
            })
        };
        let one = run(1, 3);
        assert!(one.len() > 300 && one == run(4, 3) && one != run(1, 4));
    }

    #[test]
    fn wrong_light_is_refused_and_leaves_the_camera_as_it_was() {
        let mut c = camera(plain(), [2, 1]);
        c.feed(1.0, &[1.0, 2.0]).unwrap();
        for (time, light) in [(1.0, vec![1.0, 2.0]), (2.0, vec![1.0]), (2.0, vec![1.0, -1.0]), (2.0, vec![f32::NAN, 1.0])] {
            assert!(c.feed(time, &light).is_err());
            assert_eq!(c.time_s(), 1.0);
        }
        assert!(EventCamera::new(plain(), [0, 5], 1).is_err());
    }
}
