//! Speed of the traces on the double Gauss: `cargo bench -p diopter-lens --bench trace`.
//!
//! The eleven surfaces of US 2,673,491 (`double-gauss-50mm`), rays of a 14 mm wide beam at 14°, one core. Prints medians of
//! several runs: nanoseconds a ray and surface (12 with the film, as peers count), rays a second, and the ratio to the plain
//! trace of the same run; then how long lenses take to be ready, and what analyses take.

use diopter_lens::analysis::Bench;
use diopter_lens::batch::{double, single};
use diopter_lens::compound::{CompoundLens, Setting};
use diopter_lens::optimise::{MeritSheet, Optimisation};
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::{Focus, State, System, embedded};
use glam::DVec3;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

const RAYS: usize = 1 << 20;
const SURFACES: f64 = 12.0;

fn median(mut run: impl FnMut() -> f64) -> f64 {
    let mut times: Vec<f64> = (0..7).map(|_| run()).collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn ray(i: usize) -> TracedRay {
    let side = 1024;
    let (u, v) = ((i % side) as f64 / side as f64 - 0.5, (i / side) as f64 / side as f64 - 0.5);
    let direction = DVec3::new(0.0, 0.2419, 0.9703).normalize();
    let at = DVec3::new(14.0 * u, 14.0 * v, 12.0);
    TracedRay { position: at - direction * 40.0, direction }
}

/// What the derivatives of all residuals by all variables cost, of what the residuals themselves do.
fn derivatives(lens: &diopter_lens::Prescription) {
    let sheet = "entrance_pupil = 12.5\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n[[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\n\
        [[variable]]\nsurfaces = 11\nwhat = \"gap\"\n[[operand]]\nkind = \"spot\"\n";
    let problem = MeritSheet::parse(sheet, "bench").ok().and_then(|s| Optimisation::new(lens, &s).ok()).expect("a merit");
    let timed = |run: &dyn Fn() -> f64| {
        median(|| {
            let start = Instant::now();
            for _ in 0..20 {
                black_box(run());
            }
            start.elapsed().as_secs_f64() / 20.0
        })
    };
    let (residuals, all) = (timed(&|| problem.start_merit()), timed(&|| problem.start_derivatives()[0][0]));
    let variables = problem.start_derivatives().len();
    println!(
        "residuals of two spots {:>9.1} µs; derivatives by {variables} variables {:>9.1} µs: {:.2} times",
        residuals * 1e6,
        all * 1e6,
        all / residuals
    );
}

fn main() {
    let p = embedded("double-gauss-50mm").expect("embedded");
    let system = System::at(&p, State::default());
    let n = system.indices(587.6);
    let show = |name: &str, rays: f64, seconds: f64, plain: f64| {
        println!(
            "{name:<28} {:>8.2} ns a ray-surface {:>8.2} Mrays/s {:>7.1} times the plain trace",
            seconds / rays / SURFACES * 1e9,
            rays / seconds * 1e-6,
            plain / (seconds / rays)
        );
    };
    let few = RAYS / 8;
    let plain = median(|| {
        let start = Instant::now();
        for i in 0..few {
            let _ = black_box(system.trace(ray(i * 8), &n, TraceDirection::ToFilm, Apertures::Clip));
        }
        start.elapsed().as_secs_f64()
    });
    let per_ray = plain / few as f64;
    show("plain f64", few as f64, plain, per_ray);

    let batch = single::Batch::new(&system);
    let mut n32 = single::Indices::default();
    batch.indices(&[587.6; single::LANES], &mut n32);
    let fresh: Vec<single::Packet> = (0..RAYS / single::LANES)
        .map(|k| {
            let mut packet = single::Packet::default();
            for i in 0..single::LANES {
                let r = ray(k * single::LANES + i);
                packet.set(i, r.position.as_vec3().to_array(), r.direction.as_vec3().to_array());
            }
            packet
        })
        .collect();
    let mut work = fresh.clone();
    let fast = median(|| {
        work.clone_from(&fresh);
        let start = Instant::now();
        for packet in &mut work {
            black_box(batch.trace(packet, &n32, TraceDirection::ToFilm));
        }
        start.elapsed().as_secs_f64()
    });
    show("packets, f32", RAYS as f64, fast, per_ray);
    // Without the memory of a million rays: the same few packets again and again, as pictures trace them. Each pass is shorter than what
    // else runs on the machine takes at a time, so that the median of many is that of a free core.
    let short = fresh[..128].to_vec();
    let mut few_packets = short.clone();
    let mut passes: Vec<f64> = (0..4096)
        .map(|_| {
            few_packets.clone_from(&short);
            let start = Instant::now();
            for packet in &mut few_packets {
                black_box(batch.trace(packet, &n32, TraceDirection::ToFilm));
            }
            start.elapsed().as_secs_f64()
        })
        .collect();
    passes.sort_by(f64::total_cmp);
    show("the same, 4096 rays in cache", (128 * single::LANES) as f64, passes[passes.len() / 2], per_ray);

    let batch = double::Batch::new(&system);
    let mut n64 = double::Indices::default();
    batch.indices(&[587.6; double::LANES], &mut n64);
    let fresh: Vec<double::Packet> = (0..RAYS / double::LANES)
        .map(|k| {
            let mut packet = double::Packet::default();
            for i in 0..double::LANES {
                let r = ray(k * double::LANES + i);
                packet.set(i, r.position.to_array(), r.direction.to_array());
            }
            packet
        })
        .collect();
    let mut work = fresh.clone();
    let fast = median(|| {
        work.clone_from(&fresh);
        let start = Instant::now();
        for packet in &mut work {
            black_box(batch.trace(packet, &n64, TraceDirection::ToFilm));
        }
        start.elapsed().as_secs_f64()
    });
    show("packets, f64", RAYS as f64, fast, per_ray);
    let short = fresh[..256].to_vec();
    let mut few_packets = short.clone();
    let mut passes: Vec<f64> = (0..4096)
        .map(|_| {
            few_packets.clone_from(&short);
            let start = Instant::now();
            for packet in &mut few_packets {
                black_box(batch.trace(packet, &n64, TraceDirection::ToFilm));
            }
            start.elapsed().as_secs_f64()
        })
        .collect();
    passes.sort_by(f64::total_cmp);
    show("the same, 4096 rays in cache", (256 * double::LANES) as f64, passes[passes.len() / 2], per_ray);

    for (name, film_mm) in [
        ("wide-22mm", [36.0, 24.0]),
        ("double-gauss-50mm", [36.0, 24.0]),
        ("telephoto-250mm", [36.0, 24.0]),
        ("fisheye-10mm", [20.0, 14.0]),
        ("zoom-70-200mm-f2.8", [36.0, 24.0]),
        ("anamorphic-31mm", [24.0, 18.0]),
    ] {
        let seconds = median(|| {
            let start = Instant::now();
            let p = Arc::new(embedded(name).expect("embedded"));
            let setting = Setting { focal_length: None, f_number: None, focus: Focus::Infinity, iris: None, film_mm };
            black_box(CompoundLens::new(p, &setting).expect("a lens"));
            start.elapsed().as_secs_f64()
        });
        println!("{name:<28} ready in {:>6.1} ms (read, focused, pupils found)", seconds * 1e3);
    }
    derivatives(&p);
    let bench = Bench::at_infinity(&system);
    let timed = |name: &str, job: &dyn Fn()| {
        let seconds = median(|| {
            let start = Instant::now();
            job();
            start.elapsed().as_secs_f64()
        });
        println!("{name:<28} {:>6.1} ms", seconds * 1e3);
    };
    timed("spots, 3 fields, 60 across", &|| {
        for f in [0.0, 10.0, 14.0] {
            black_box(bench.spot(f, 587.6, 587.6, 60, 0.0));
        }
    });
    timed("diffraction MTF, 3 fields", &|| {
        for f in [0.0, 10.0, 14.0] {
            black_box(bench.diffraction_mtf(f, &[(587.6, 1.0)], &[10.0, 20.0, 30.0, 40.0, 50.0], 0.0));
        }
    });
}
