//! Probe exposures of autofocus: the pixels of a zone through the real lens, mosaiced, noisy, clipped.

use super::measure::Frame;
use super::motor::{Drive, Motor};
use crate::camera::Camera;
use crate::expose::{ExposeError, Half, Integrator, ProgressReporter, Response, Settings, expose};
use crate::shutter::Shutter;
use diopter_image::{ExposureFacts, FocalPlane};
use diopter_lens::Lens;
use diopter_scene::Scene;
use diopter_sensor::read_out::Window;
use diopter_sensor::{ReadOut, Reading, Sensor};

/// The longest that a probe gathers light, s: a slow viewfinder.
const LONGEST_S: f64 = 1.0 / 15.0;
/// Fraction of saturation that the brightest cells are to reach, and the most speed that is set for it.
const WANTED_LEVEL: f64 = 0.5;
const MOST_SPEED: f64 = 6400.0;
/// Pixels of the sensor a cell is averaged over, along each axis: the most.
const MOST_PIXELS: usize = 4;
/// A half of the samples that is so many times the other, and the brightest tenth of the cells, is a stray path.
const SPIKE: [f32; 2] = [3.0, 1.5];

/// What autofocus looks at.
pub struct View<'a> {
    /// Posed for the moment.
    pub scene: &'a Scene,
    /// The camera, at its aperture.
    pub camera: &'a Camera,
    /// What sees.
    pub sensor: &'a Sensor,
    /// How it is read; autofocus sets its own speed.
    pub reading: &'a Reading,
    /// How light is gathered; samples are autofocus's own.
    pub settings: &'a Settings,
    /// Fraction of the light that a filter before the lens lets through.
    pub filter: f64,
    /// May stop it.
    pub watch: &'a ProgressReporter<'a>,
}

/// Takes probes.
pub(super) struct Prober<'a> {
    pub view: &'a View<'a>,
    response: Response,
    /// Focused at infinity: films of probes are moved from there.
    lens: Lens,
    /// Exposure time (s) and speed, once settled.
    exposure: Option<(f64, f64)>,
    pub drive: Drive,
    pub rays: u64,
    pub probes: u32,
    /// Readings so far: each has its own noise.
    readings: u64,
}

impl<'a> Prober<'a> {
    /// A view whose focus drive stands at a place, mm.
    pub fn new(view: &'a View<'a>, motor: Motor, start_mm: f64) -> Self {
        let lens = match view.camera.lens.refocused(diopter_lens::Focus::Infinity) {
            Ok(lens) => lens,
            Err(_) => view.camera.lens.clone(),
        };
        let drive = Drive::new(motor, start_mm);
        Prober { view, response: Response::sensor(view.sensor), lens, exposure: None, drive, rays: 0, probes: 0, readings: 0 }
    }

    /// Exposes a piece of the picture (`[left, top, width, height]`, fractions) on `columns` × `rows` cells where the drive stands, and reads
    /// it twice. `None` where the lens cannot stand there.
    pub fn frame(
        &mut self,
        piece: [f64; 4],
        [columns, rows]: [usize; 2],
        spp: u32,
        half: Option<Half>,
    ) -> Result<Option<Frame>, ExposeError> {
        let view = self.view;
        let Ok(lens) = self.lens.with_extension(self.drive.stands_mm()) else { return Ok(None) };
        let film = view.camera.film.piece(piece, columns, rows);
        let [px, py] = view.sensor.pitch_mm();
        let film = crate::Film { pixel_area_mm2: px * py, ..film };
        let cell = (film.width_mm / columns as f64).min(film.height_mm / rows as f64);
        let camera = Camera { lens, film, motion: view.camera.motion.clone() };
        let settings = Settings {
            spp,
            samples: 0..spp,
            time_limit_s: None,
            truth: false,
            shutter_times: Default::default(),
            half,
            redraw: true,
            integrator: Integrator::Path,
            // Samples of the halves of a pupil are each other's complement: of one seed, their errors would look like a shift; a look that is repeated must not err
            // alike. Contrasts of many places are compared instead: of one seed, they err alike.
            seed: view.settings.seed ^ half.map_or(0, |_| u64::from(self.probes).wrapping_mul(0x9e37_79b9_7f4a_7c15)),
            ..view.settings.clone()
        };
        let quiet = ProgressReporter { cancel: view.watch.cancel, progress: &|_| () };
        // A second of light; the sensor's readings take their fraction of it.
        let mut plane =
            expose(view.scene, &camera, &Shutter::global(1.0), &self.response, &settings, &ExposureFacts::default(), &quiet)?;
        self.rays += (columns * rows) as u64 * u64::from(spp);
        self.probes += 1;
        plane.mean.data.iter_mut().chain(&mut plane.half_difference.data).for_each(|v| *v *= view.filter as f32);
        despike(&mut plane);
        // Pixels that a cell stands for, whole patterns of filters.
        let side = view.sensor.cfa.columns().max(view.sensor.cfa.rows());
        let pixels = ((cell / px.min(py)) as usize / side * side).clamp(side, MOST_PIXELS.max(side));
        let (time, iso) = match self.exposure {
            Some(found) => found,
            None => {
                let found = self.settle(&plane, pixels);
                self.exposure = Some(found);
                found
            }
        };
        self.drive.wait(time);
        let half_time = 0.5 * time;
        let mut readings = [Vec::new(), Vec::new()];
        for (k, reading) in readings.iter_mut().enumerate() {
            let sign = if k == 0 { 1.0 } else { -1.0 };
            let electrons = |i: usize| (plane.mean.data[i] + sign * plane.half_difference.data[i]) * half_time as f32;
            *reading = self.read(&plane, pixels, electrons, half_time, iso).0;
        }
        Ok(Some(Frame { columns, rows, channels: self.response.bands.len(), readings }))
    }

    /// Time and speed at which the brightest cells reach half of what can be held: as a camera tries them out.
    fn settle(&mut self, plane: &FocalPlane, pixels: usize) -> (f64, f64) {
        let [lowest, highest] = self.view.sensor.iso_range();
        let most = highest.min(MOST_SPEED.max(lowest));
        let (mut time, mut iso) = (LONGEST_S, lowest);
        for _ in 0..12 {
            let half_time = (0.5 * time) as f32;
            let (mut levels, full) = self.read(plane, pixels, |i| plane.mean.data[i] * half_time, 0.5 * time, iso);
            levels.sort_by(f32::total_cmp);
            let bright = f64::from(levels[(levels.len() - 1) * 49 / 50]);
            let Ok(step) = self.view.sensor.at_iso(iso) else { break };
            let level = if full > 0.02 { 4.0 } else { bright / self.view.sensor.saturation_e(&step) };
            let factor = WANTED_LEVEL / level.max(1e-6);
            if factor < 1.0 {
                if level > 2.0 * WANTED_LEVEL && time > 1e-6 {
                    time *= factor.max(0.05);
                    continue;
                }
                break;
            }
            // Too dark: longer, then faster.
            let longer = (LONGEST_S / time).min(factor);
            if longer > 1.01 {
                time *= longer;
                continue;
            }
            let faster = self.view.sensor.nearest_iso((iso * factor).min(most)).min(most);
            if faster <= iso * 1.01 {
                break;
            }
            iso = faster;
        }
        (time, iso)
    }

    /// Electrons a pixel that a reading finds in every cell and channel, and the fraction of full cells.
    fn read(
        &mut self,
        plane: &FocalPlane,
        pixels: usize,
        electrons: impl Fn(usize) -> f32,
        time: f64,
        iso: f64,
    ) -> (Vec<f32>, f64) {
        let (columns, rows, n) = (plane.width(), plane.height(), self.response.bands.len());
        let sensor = self.view.sensor;
        self.readings += 1;
        let seed = self.view.reading.seed ^ self.readings.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let reading = Reading { iso, seed, ..self.view.reading.clone() };
        let size = [columns * pixels, rows * pixels];
        let (Ok(step), Ok(reader)) = (sensor.at_iso(iso), ReadOut::new(sensor, &reading, size, &plane.bands, time)) else {
            return (vec![0.0; columns * rows * n], 0.0);
        };
        let saturation = sensor.saturation_e(&step) / step.gain_e_per_dn;
        let mut seen = vec![0.0f32; columns * rows * n];
        let mut full_cells = 0;
        let (mut line, mut numbers) = (vec![0.0f32; size[0] * n], vec![0u16; size[0] * pixels]);
        let mut counts = vec![0u32; columns * n];
        for row in 0..rows {
            for x in 0..size[0] {
                for c in 0..n {
                    line[x * n + c] = electrons((row * columns + x / pixels) * n + c).max(0.0);
                }
            }
            // All rows of a cell see the same light.
            let all: Vec<f32> = (0..pixels).flat_map(|_| line.iter().copied()).collect();
            let window = Window { first: row * pixels, data: &all };
            reader.rows(&window, row * pixels, &mut numbers);
            counts.iter_mut().for_each(|c| *c = 0);
            let to = &mut seen[row * columns * n..(row + 1) * columns * n];
            let mut over = vec![0u32; columns];
            for y in 0..pixels {
                for x in 0..size[0] {
                    let i = x / pixels * n + sensor.cfa.channel_at(x, row * pixels + y);
                    let signal = f64::from(numbers[y * size[0] + x]) - step.black_level_dn;
                    to[i] += (signal * step.gain_e_per_dn) as f32;
                    counts[i] += 1;
                    over[x / pixels] += u32::from(signal >= 0.97 * saturation);
                }
            }
            to.iter_mut().zip(&counts).for_each(|(v, n)| *v /= (*n).max(1) as f32);
            full_cells += over.iter().filter(|o| **o as usize * 4 > pixels * pixels).count();
        }
        (seen, full_cells as f64 / (columns * rows) as f64)
    }
}

/// Takes out what single light paths of few samples bring and no sensor would see: cells of which one half of the samples is far brighter
/// than the other and than the picture get the other's value.
fn despike(plane: &mut FocalPlane) {
    let n = plane.bands.len();
    let light: Vec<f32> = plane.mean.data.chunks_exact(n).map(|p| p.iter().sum()).collect();
    let mut sorted = light.clone();
    sorted.sort_by(f32::total_cmp);
    let bright = sorted[(sorted.len() - 1) * 9 / 10];
    for (i, mean) in light.iter().enumerate() {
        let cell = i * n..(i + 1) * n;
        let half: f32 = plane.half_difference.data[cell.clone()].iter().sum();
        let (more, less) = (mean + half.abs(), mean - half.abs());
        if more > SPIKE[0] * less && more > SPIKE[1] * bright {
            for k in cell {
                plane.mean.data[k] -= half.signum() * plane.half_difference.data[k];
                plane.half_difference.data[k] = 0.0;
            }
        }
    }
}
