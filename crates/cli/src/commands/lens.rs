//! `lens`: what a lens is and what it does.
//!
//! A verb is a file in `lens/` with a struct: its doc is the help, its fields are the flags, its method `run` does it. Here it is a line in
//! `verbs!` and one that declares the file. Analyses without flags of their own are all in `lens/analyses.rs`.

mod analyses;
mod bench;
mod calibrate;
mod coating;
mod convert;
mod draw;
mod fit;
mod ghosts;
mod image_files;
mod info;
mod list;
mod mtf;
mod optimise;
mod psf;
mod report;
mod spot;
mod tolerance;
mod trace;
mod wavefront;

use super::print_json;
use std::num::NonZeroUsize;

/// Flags that every verb of the program has.
#[derive(Clone, Copy, Debug)]
pub struct GlobalFlags {
    /// Threads to use; all without.
    pub threads: Option<NonZeroUsize>,
    /// Print machine-readable results.
    pub json: bool,
}

/// The verbs as clap reads them, and the dispatch to them: `file::Struct` each, in the order of the help, in which those of `analyses.rs` take the place of the semicolon. The name that is typed is that of the struct.
macro_rules! verbs {
    ($($file:ident::$verb:ident,)*; $($later:ident::$last:ident,)*) => {
        #[derive(clap::Subcommand, Debug)]
        pub enum LensVerb {
            $($verb($file::$verb),)*
            #[command(flatten)]
            Analysis(analyses::Analysis),
            $($last($later::$last),)*
        }

        impl LensVerb {
            /// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
            pub fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
                match self {
                    $(LensVerb::$verb(asked) => asked.run(global),)*
                    LensVerb::Analysis(asked) => asked.run(global),
                    $(LensVerb::$last(asked) => asked.run(global),)*
                }
            }
        }
    };
}

verbs! {
    list::List,
    info::Info,
    draw::Draw,
    trace::Trace,
    spot::Spot,
    psf::Psf,
    wavefront::Wavefront,
    mtf::Mtf,
    ;
    report::Report,
    coating::Coating,
    ghosts::Ghosts,
    calibrate::Calibrate,
    tolerance::Tolerance,
    tolerance::Build,
    optimise::Optimise,
    fit::Fit,
    convert::Convert,
}
