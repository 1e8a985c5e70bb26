//! Where a camera was when a picture was taken, in the axes of other programs.
//!
//! The world is the scene's: right-handed, metres, +Y up. diopter, OpenGL, glTF, Blender and nerfstudio have camera axes x right, y up, z backward; OpenCV, COLMAP and Kalibr x right,
//! y down, z forward.

use crate::camera_motion::CameraMotion;
use crate::moving_part::MovingState;
use diopter_image::RowTimes;
use diopter_lens::camera_model::CameraModel;
use glam::{Affine3A, DAffine3, DMat3, DMat4, DQuat, DVec3};

/// OpenCV's camera axes from OpenGL's, and the other way: y and z turn round.
const FLIP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);

/// A place of the camera at a moment of an exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The row (or column) that is open then; `None` where all are.
    pub row: Option<usize>,
    /// `start`, `middle` or `end` of the time that it is open.
    pub when: &'static str,
    /// Seconds since the exposure began.
    pub time_s: f64,
    /// World from camera; camera axes x right, y up, z backward.
    pub world_from_camera: DAffine3,
}

impl Pose {
    /// Camera from world with the camera axes of OpenCV: a unit quaternion with w ≥ 0, and a translation, m.
    pub fn opencv(&self) -> (DQuat, DVec3) {
        let camera_from_world = self.world_from_camera.inverse();
        let rotation = DQuat::from_mat3(&(FLIP * camera_from_world.matrix3)).normalize();
        let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
        (rotation, FLIP * camera_from_world.translation)
    }

    /// World from camera with the axes of OpenGL, `[row][column]`; the translation, m, is the last column.
    pub fn opengl_rows(&self) -> [[f64; 4]; 4] {
        DMat4::from(self.world_from_camera).transpose().to_cols_array_2d()
    }
}

/// A picture and the places of the camera while it was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its file.
    pub picture: String,
    /// Scene time at which the exposure began, s.
    pub at_s: f64,
    /// Model and distance of the plane in focus (m; `None` for infinity) of this picture, where they are not those of all.
    pub camera: Option<(CameraModel, Option<f64>)>,
    /// In the order of rows and times; see [`poses`].
    pub poses: Vec<Pose>,
    /// Where what moves against shake stood at equal steps of the exposure; empty where nothing does.
    pub moving: Vec<MovingState>,
}

impl Frame {
    /// The pose that stands for the whole picture: of the middle row, in the middle of the time that it is open; `None` without poses.
    pub fn middle(&self) -> Option<&Pose> {
        self.poses.get(self.poses.len() / 2)
    }
}

/// World from camera in double precision, the rotation made one again.
fn place(at: Affine3A) -> DAffine3 {
    let (_, rotation, translation) = at.to_scale_rotation_translation();
    DAffine3::from_rotation_translation(rotation.as_dquat().normalize(), translation.as_dvec3())
}

/// Start, middle and end of the time that is open: of all of the picture, or where rows follow each other, of its first, middle and last one. `size`: columns and rows.
pub fn poses(motion: &CameraMotion, times: &RowTimes, size: [usize; 2]) -> Vec<Pose> {
    let lines = size[usize::from(!times.columns)];
    let run = times.open_s[1] != 0.0 || times.close_s[1] != 0.0;
    let which: Vec<Option<usize>> =
        if run { vec![Some(0), Some(lines.saturating_sub(1) / 2), Some(lines.saturating_sub(1))] } else { vec![None] };
    let of = |row: Option<usize>| {
        let (open, close) = times.of(row.unwrap_or(0));
        [("start", open), ("middle", 0.5 * (open + close)), ("end", close)].map(|(when, time_s)| Pose {
            row,
            when,
            time_s,
            world_from_camera: place(motion.at(time_s)),
        })
    };
    which.into_iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::look_at;
    use glam::Vec3;

    #[test]
    fn a_point_lies_where_each_convention_says() {
        let at = look_at(Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 2.5, -5.0), Vec3::Y).unwrap();
        let pose = Pose { row: None, when: "start", time_s: 0.0, world_from_camera: place(at) };
        // 10 m ahead, 2 m to the right, 1 m up.
        let world = at.transform_point3(Vec3::new(2.0, 1.0, -10.0)).as_dvec3();
        let (q, t) = pose.opencv();
        // Cameras are placed in single precision: 1e-7 of 10 m, several times.
        assert!((q * world + t - DVec3::new(2.0, -1.0, 10.0)).length() < 5e-5 && q.w >= 0.0 && q.is_normalized());
        let rows = pose.opengl_rows();
        let back = |i: usize| rows[i][0] * 2.0 + rows[i][1] - 10.0 * rows[i][2] + rows[i][3];
        assert!((DVec3::new(back(0), back(1), back(2)) - world).length() < 5e-5 && rows[3] == [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn rows_that_follow_each_other_have_poses_of_their_own() {
        let motion = CameraMotion::sampled(1.0, |t| Affine3A::from_translation(Vec3::X * t as f32));
        let all = poses(&motion, &RowTimes { open_s: [0.0, 0.1], close_s: [0.1, 0.1], columns: false }, [16, 9]);
        assert_eq!(all.len(), 9);
        let last = all[8];
        assert!(last.row == Some(8) && last.when == "end" && (last.world_from_camera.translation.x - 0.9).abs() < 1e-6);
        let frame = Frame { picture: String::new(), at_s: 0.0, camera: None, poses: all, moving: Vec::new() };
        assert_eq!(frame.middle().map(|p| (p.row, p.when)), Some((Some(4), "middle")));
        let global = poses(&motion, &RowTimes { open_s: [0.0; 2], close_s: [1.0, 0.0], columns: false }, [16, 9]);
        assert!(global.len() == 3 && global[1].row.is_none() && (global[1].world_from_camera.translation.x - 0.5).abs() < 1e-6);
    }
}
