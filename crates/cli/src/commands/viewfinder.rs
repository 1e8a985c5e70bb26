//! `viewfinder`: a camera in the browser.

use super::print_json;
use crate::UsageError;
use crate::args::{self, Viewfinder};
use crate::output;
use crate::watch::{self, say, warn};
use diopter_viewfinder::{Options, ServeError};
use std::process::{Command, Stdio};

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Viewfinder, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let options = Options {
        shot: args::shot_of(args.subject.as_deref())?,
        folders: args.folder.clone(),
        port: args.port,
        stop: watch::stop(),
        now: output::now,
    };
    let ready = |address: &str| {
        say(&format!("the viewfinder is at {address}\nCtrl-C ends it"));
        if json {
            // Whoever started this reads the address; where nobody reads, the camera works all the same.
            let _ = print_json(&serde_json::json!({ "address": address }));
        }
        if args.open
            && let Err(e) = open_in_browser(address)
        {
            warn(&format!("no browser could be started ({e}): open the address above"));
        }
    };
    diopter_viewfinder::serve(&options, ready, &mut warn).map_err(|e| match e {
        ServeError::Shot(e) => e.into(),
        ServeError::Port { .. } => UsageError(e.into()).into(),
        e => e.into(),
    })
}

/// Asks the system to show an address.
fn open_in_browser(address: &str) -> std::io::Result<()> {
    let mut command = if cfg!(target_os = "macos") {
        Command::new("open")
    } else if cfg!(windows) {
        let mut rundll = Command::new("rundll32");
        rundll.arg("url.dll,FileProtocolHandler");
        rundll
    } else {
        Command::new("xdg-open")
    };
    command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().map(drop)
}
