//! One file a step.

pub mod black_level;
pub mod camera_matrix;
pub mod demosaic;
pub mod encode;
pub mod tone;
pub mod white_balance;
