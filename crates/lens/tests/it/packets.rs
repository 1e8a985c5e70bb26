//! Packets beside the plain trace.

use diopter_lens::System;
use diopter_lens::batch::double::{Batch, Indices, LANES, Packet};
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use glam::DVec3;

/// Place and direction of a ray of a packet.
pub fn ray_of(packet: &Packet, i: usize) -> TracedRay {
    TracedRay {
        position: DVec3::new(packet.x[i], packet.y[i], packet.z[i]),
        direction: DVec3::new(packet.dx[i], packet.dy[i], packet.dz[i]),
    }
}

/// Traces a packet of rays to the film and each of them by the plain trace, which must agree: to 1e-9 mm, and 1e-11 of a direction.
/// Answers with the rays that come through, by their number, as the packet has them.
pub fn traced_alike(system: &System, n: &[f64], ray: impl Fn(usize) -> TracedRay) -> Vec<(usize, TracedRay)> {
    let mut packet = Packet::default();
    for i in 0..LANES {
        packet.set(i, ray(i).position.to_array(), ray(i).direction.to_array());
    }
    let mask = Batch::new(system).trace(&mut packet, &Indices::uniform(n), TraceDirection::ToFilm);
    let mut through = Vec::new();
    for i in 0..LANES {
        let plain = system.trace(ray(i), n, TraceDirection::ToFilm, Apertures::Clip);
        assert_eq!(plain.is_ok(), mask >> i & 1 == 1, "{i}");
        let Ok(plain) = plain else { continue };
        let found = ray_of(&packet, i);
        assert!((found.position - plain.position).length() < 1e-9, "{i}");
        assert!((found.direction - plain.direction).length() < 1e-11, "{i}");
        through.push((i, found));
    }
    through
}
