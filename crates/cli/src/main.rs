//! The program: [`diopter_cli::run`] on what was typed.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(diopter_cli::run(std::env::args_os()))
}
