//! Manual pages and completions, from the same source as the help.

use crate::output::Output;
use crate::watch::say;
use crate::{UsageError, help};
use anyhow::{Context, anyhow};
use clap::Command;
use clap_mangen::Man;
use std::io::Write;
use std::path::Path;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn completions(shell: clap_complete::Shell) -> anyhow::Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut help::command(), "diopter", &mut text);
    write_all(&text)
}

/// Prints the page of a verb (of the program without one), or writes all pages into a folder.
pub fn man(verb: &[String], folder: Option<&Path>, json: bool) -> anyhow::Result<()> {
    let all = built();
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let mut pages = Vec::new();
        collect(&all, &mut pages)?;
        let mut written = Vec::new();
        for (name, text) in pages {
            written.push(Output::prepare(&folder.join(name))?.commit(|to| Ok(to.write_all(&text)?))?);
        }
        say(&format!("wrote {} pages into {}", written.len(), folder.display()));
        return if json { super::print_json(&serde_json::json!({ "files": written })) } else { Ok(()) };
    }
    let mut found = &all;
    for word in verb.iter().flat_map(|w| w.split_whitespace()) {
        found = found.find_subcommand(word).ok_or_else(|| {
            let known: Vec<&str> = found.get_subcommands().map(Command::get_name).collect();
            let expected = match known.is_empty() {
                true => format!("nothing after \"{}\", which has no verbs of its own", found.get_name()),
                false => format!("one of {}", known.join(", ")),
            };
            UsageError(anyhow!("verb \"{word}\": expected {expected}"))
        })?;
    }
    write_all(&page(found)?.1)
}

/// The command line with what is added when it is built: names of the verbs' pages, flags that every verb has.
fn built() -> Command {
    let mut command = help::command().disable_help_subcommand(true);
    command.build();
    command
}

/// Name and text of a verb's page.
fn page(command: &Command) -> anyhow::Result<(String, Vec<u8>)> {
    let man = Man::new(command.clone()).source(concat!("diopter ", env!("CARGO_PKG_VERSION"))).manual("diopter manual");
    let mut text = Vec::new();
    man.render(&mut text)?;
    Ok((man.get_filename(), text))
}

/// The pages of a verb and of all its own verbs.
fn collect(command: &Command, pages: &mut Vec<(String, Vec<u8>)>) -> anyhow::Result<()> {
    pages.push(page(command)?);
    command.get_subcommands().filter(|c| !c.is_hide_set()).try_for_each(|c| collect(c, pages))
}

fn write_all(text: &[u8]) -> anyhow::Result<()> {
    Ok(std::io::stdout().write_all(text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_verb_has_a_page_of_its_own() {
        let mut pages = Vec::new();
        collect(&built(), &mut pages).unwrap();
        let mut names: Vec<&str> = pages.iter().map(|p| p.0.as_str()).collect();
        for wanted in ["diopter.1", "diopter-shoot.1", "diopter-lens-draw.1", "diopter-calc-exposure.1", "diopter-man.1"] {
            assert!(names.contains(&wanted), "{wanted}: {names:?}");
        }
        names.sort_unstable();
        let count = names.len();
        names.dedup();
        assert_eq!(names.len(), count);
        let text = |name: &str| {
            let page = pages.iter().find(|p| p.0 == name).unwrap();
            String::from_utf8(page.1.clone()).unwrap()
        };
        let shoot = text("diopter-shoot.1");
        for part in [".TH", "diopter\\-shoot", ".SH SCENE", ".SH EXPOSURE", "microlens\\-gap"] {
            assert!(shoot.contains(part), "{part}: {shoot}");
        }
        assert!(text("diopter-lens-draw.1").contains("diopter lens draw"));
    }

    #[test]
    fn a_page_of_no_verb_names_the_verbs() {
        let told = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
            man(&words, None, false).unwrap_err().to_string()
        };
        assert!(told(&["shot"]).contains("shoot"));
        assert!(told(&["lens", "drew"]).contains("draw"));
        assert!(told(&["denoise", "it"]).contains("no verbs of its own"));
    }
}
