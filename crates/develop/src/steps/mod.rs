//! One file a step.

pub mod black_level;
pub mod camera_matrix;
pub mod defects;
pub mod demosaic;
pub mod encode;
pub mod exposure;
pub mod grade;
pub mod highlights;
pub mod lens;
pub mod local;
pub mod noise;
pub mod resize;
pub mod row_noise;
pub mod sharpen;
pub mod tone;
pub mod warp;
pub mod white_balance;
