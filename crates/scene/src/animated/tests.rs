use super::*;
use crate::motion::{AnimatedProperty, Animation, AnimationPlayback, Channel, Extrapolation, KeyInterpolation, Node};
use glam::Quat;

/// A node that turns about z, `turns` times a second.
fn turning(turns: f32) -> (Vec<Node>, Vec<Animation>) {
    let thirds = [0.0, 1.0, 2.0, 3.0].map(|k: f32| Quat::from_rotation_z(k * std::f32::consts::TAU / 3.0).to_array());
    let channel = Channel {
        node: 0,
        property: AnimatedProperty::Rotation,
        interpolation: KeyInterpolation::Linear,
        times_s: [0.0, 1.0, 2.0, 3.0].map(|k| k / (3.0 * turns)).to_vec(),
        values: thirds.concat(),
    };
    (vec![Node::new("hub")], vec![Animation { name: "turn".into(), channels: vec![channel] }])
}

#[test]
fn a_track_stays_close_to_the_true_way() {
    // Whole turns in the exposure: equal ends must not pass for standing still.
    for (turns, span) in [(1.0, 1.0), (30.0, 1.0), (30.0, 0.01), (7.3, 4.0)] {
        let (nodes, animations) = turning(turns);
        let playing = AnimationPlayback { animations: vec![0], ending: Extrapolation::Loop, frozen_at_s: None };
        let timeline = Timeline::new(&nodes, &animations, &playing);
        let track = Track::of_node(&timeline, 0, &[Vec3::X], 1.0, 0.3, span);
        for i in 0..5000 {
            let x = (i as f64 + 0.37) / 5000.0;
            let [a, b] = [track.at(x as f32), timeline.world(0, 0.3 + x * span)].map(|m| m.transform_point3(Vec3::X));
            // The fraction of the exposure itself has single precision.
            let slack = 1e-7 * span as f32 * turns * 7.0;
            assert!((a - b).length() < 1.5e-4 + 3.0 * slack, "{turns} × {span} s at {x}: {a} {b}");
        }
    }
}

#[test]
fn boxes_of_a_segment_hold_the_way_within_it() {
    let around = |i: usize| {
        let (s, c) = (i as f32 / 64.0 * 9.0).sin_cos();
        let p = Vec3::new(c, s, 0.1 * i as f32);
        Bounds { min: p - 0.1, max: p + 0.1 }
    };
    let boxes: Vec<Bounds> = (0..=64).map(around).collect();
    for count in [1, 4, 64, 128] {
        for s in 0..count {
            let [a, b] = segment_boxes(&boxes, s, count);
            for i in 0..=20 {
                let f = i as f32 / 20.0;
                let (k, g) = step((s as f32 + f) / count as f32, 64);
                let lo = boxes[k].min + (boxes[k + 1].min - boxes[k].min) * g;
                let hi = boxes[k].max + (boxes[k + 1].max - boxes[k].max) * g;
                assert!(
                    (a.min + (b.min - a.min) * f).cmple(lo + 1e-5).all() && (a.max + (b.max - a.max) * f).cmpge(hi - 1e-5).all()
                );
            }
        }
    }
}
