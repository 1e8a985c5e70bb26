//! `lesson`: figures and tables of a subject with two lines of text each, made by the commands that a reader can type.
//!
//! A lesson is a data file (`lessons/*.toml`). Its commands are run by this program itself, one after another, in the folder that is written.

use super::print_json;
use crate::UsageError;
use crate::args::LessonArgs;
use crate::document::{self, Block, Document};
use crate::output::Output;
use crate::own_program::OwnProgram;
use crate::paint;
use crate::watch::{self, say};
use anyhow::{Context, anyhow};
use diopter::lesson::Lesson;
use diopter::sensor::nearest;
use std::fmt::Write as _;
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Names and texts of the lessons, in the order of a course.
const LESSONS: &[(&str, &str)] = &[
    ("thin-lens", include_str!("../lessons/thin-lens.toml")),
    ("spherical-aberration", include_str!("../lessons/spherical-aberration.toml")),
    ("pinhole", include_str!("../lessons/pinhole.toml")),
    ("compound-lenses", include_str!("../lessons/compound-lenses.toml")),
    ("field-of-view", include_str!("../lessons/field-of-view.toml")),
    ("formats", include_str!("../lessons/formats.toml")),
    ("exposure-triangle", include_str!("../lessons/exposure-triangle.toml")),
    ("f-stops", include_str!("../lessons/f-stops.toml")),
    ("exposure-experiment", include_str!("../lessons/exposure-experiment.toml")),
    ("equal-exposures", include_str!("../lessons/equal-exposures.toml")),
    ("iso-ladder", include_str!("../lessons/iso-ladder.toml")),
    ("circle-of-confusion", include_str!("../lessons/circle-of-confusion.toml")),
    ("depth-from-picture", include_str!("../lessons/depth-from-picture.toml")),
    ("hyperfocal", include_str!("../lessons/hyperfocal.toml")),
    ("focus-measure", include_str!("../lessons/focus-measure.toml")),
    ("autofocus", include_str!("../lessons/autofocus.toml")),
    ("motion-blur", include_str!("../lessons/motion-blur.toml")),
    ("high-speed", include_str!("../lessons/high-speed.toml")),
    ("long-exposure", include_str!("../lessons/long-exposure.toml")),
    ("shutter", include_str!("../lessons/shutter.toml")),
    ("rolling-shutter", include_str!("../lessons/rolling-shutter.toml")),
    ("anti-aliasing", include_str!("../lessons/anti-aliasing.toml")),
    ("tone-curves", include_str!("../lessons/tone-curves.toml")),
    ("look-up-tables", include_str!("../lessons/look-up-tables.toml")),
    ("gamma", include_str!("../lessons/gamma.toml")),
];

/// Lines of a file that a page shows.
const EXCERPT: usize = 24;

/// Page that lists those of `lesson all`.
const INDEX: &str = "index.md";

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &LessonArgs, threads: Option<NonZeroUsize>, json: bool) -> anyhow::Result<()> {
    if args.name == "list" {
        return list(json);
    }
    let chosen: Vec<_> = LESSONS.iter().filter(|l| args.name == "all" || args.name == l.0).collect();
    if chosen.is_empty() {
        let names = || LESSONS.iter().map(|l| l.0).chain(["list", "all"]);
        let hint = nearest(&args.name, names()).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
        let all: Vec<&str> = names().collect();
        return Err(UsageError(anyhow!("lesson \"{}\": expected one of {}{hint}", args.name, all.join(", "))).into());
    }
    let Some(folder) = &args.output else {
        return Err(UsageError(anyhow!("lesson \"{}\": no folder; expected -o FOLDER to write it into", args.name)).into());
    };
    let on_paper = document::kind(folder) == Some(document::Kind::Pdf);
    if document::kind(folder) == Some(document::Kind::Html) {
        let wrong = anyhow!("{}: expected a folder, or a name that ends in .pdf", folder.display());
        return Err(UsageError(wrong).into());
    }
    if !on_paper && folder.exists() && !folder.is_dir() {
        let wrong = anyhow!("{}: this is a file; expected a folder, or a name that ends in .pdf", folder.display());
        return Err(UsageError(wrong).into());
    }
    let paper =
        if on_paper { Some((document::prepare(folder)?, tempfile::tempdir().context("a temporary folder")?)) } else { None };
    let folder = paper.as_ref().map_or(folder.as_path(), |p| p.1.path());
    let _held = watch::hold();
    let started = Instant::now();
    std::fs::create_dir_all(folder).with_context(|| format!("{}: this folder cannot be made", folder.display()))?;
    let runner = Runner { program: OwnProgram::new(threads)?, folder, size: args.size.map(|s| s.to_string()) };
    let (mut told, mut index) = (Vec::new(), "# Lessons\n\n".to_owned());
    let mut book = Document::default();
    for (name, text) in chosen.iter().copied() {
        let begun = Instant::now();
        let lesson = Lesson::parse(text, name)?;
        let made = runner.lesson(name, &lesson)?;
        let files = match &paper {
            Some(_) => {
                made.print(&lesson, &mut book)?;
                vec![]
            }
            None => made.write(&runner, name, &lesson)?,
        };
        writeln!(index, "- [{}]({name}.md): {}", lesson.title, lesson.text[0])?;
        told.push(serde_json::json!({ "name": name, "files": files, "seconds": begun.elapsed().as_secs_f64() }));
    }
    let mut file = None;
    if let Some((output, _)) = paper {
        book.title = if let [(_, text)] = chosen[..] { Lesson::parse(text, &args.name)?.title } else { "Lessons".into() };
        if let [Block::Chapter(_), ..] = book.blocks[..]
            && chosen.len() == 1
        {
            book.blocks.remove(0);
        }
        let path = book.write(output)?;
        say(&format!("wrote {} lessons: {}", told.len(), path.display()));
        file = Some(path);
    } else {
        if args.name == "all" {
            let output = Output::prepare(&folder.join(INDEX))?;
            output.commit(|to| Ok(to.write_all(index.as_bytes())?))?;
        }
        say(&format!("wrote {} lessons into {}", told.len(), folder.display()));
    }
    if json {
        print_json(&serde_json::json!({ "lessons": told, "file": file, "total_s": started.elapsed().as_secs_f64() }))?;
    }
    Ok(())
}

fn list(json: bool) -> anyhow::Result<()> {
    let all = LESSONS.iter().map(|(name, text)| Ok((*name, Lesson::parse(text, name)?))).collect::<anyhow::Result<Vec<_>>>()?;
    if json {
        let row = |(name, l): &(&str, Lesson)| serde_json::json!({ "name": name, "title": l.title, "text": l.text });
        return print_json(&serde_json::json!(all.iter().map(row).collect::<Vec<_>>()));
    }
    let mut out = std::io::stdout();
    for (name, lesson) in all {
        writeln!(out, "{name:<22} {}", lesson.title)?;
    }
    Ok(())
}

/// Runs the commands of lessons in a folder.
struct Runner<'a> {
    program: OwnProgram,
    folder: &'a Path,
    /// Pixels of all photographs, instead of those that the lessons say.
    size: Option<String>,
}

impl Runner<'_> {
    /// Makes all figures and tables.
    fn lesson(&self, name: &str, lesson: &Lesson) -> anyhow::Result<Made> {
        let mut made = Made { inputs: vec![], figures: vec![], tables: vec![] };
        for input in &lesson.input {
            let output = Output::prepare(&self.folder.join(&input.file))?;
            made.inputs.push(output.commit(|to| Ok(to.write_all(input.text.as_bytes())?))?);
        }
        for figure in &lesson.figure {
            let typed = self.typed(&figure.command);
            self.command(name, &typed)?;
            let path = self.folder.join(&figure.file);
            if !path.is_file() {
                return Err(anyhow!("lesson {name}: \"{typed}\" wrote no {}", figure.file));
            }
            made.figures.push((path, typed));
        }
        for table in &lesson.table {
            let typed = self.typed(&table.command);
            made.tables.push((self.command(name, &typed)?, typed));
        }
        Ok(made)
    }

    /// A command as it is run and shown: with the size that was asked for.
    fn typed(&self, command: &str) -> String {
        match &self.size {
            // The last of a flag given twice wins.
            Some(size) if command.starts_with("shoot ") => format!("{command} --size {size}"),
            _ => command.to_owned(),
        }
    }

    /// Runs one command; what it prints. Fails with what it says.
    fn command(&self, name: &str, typed: &str) -> anyhow::Result<String> {
        if watch::stopping() {
            return Err(anyhow!("stopped in lesson {name}: its page was not written"));
        }
        say(&format!("{name}: diopter {typed}"));
        self.program.run(typed, Some(self.folder)).with_context(|| format!("lesson {name}"))
    }
}

/// What the commands of a lesson made.
struct Made {
    /// Files that the commands read.
    inputs: Vec<PathBuf>,
    /// Files of figures, and their commands.
    figures: Vec<(PathBuf, String)>,
    /// Tables, and their commands.
    tables: Vec<(String, String)>,
}

impl Made {
    /// Writes the page (Markdown); all files of the lesson.
    fn write(self, runner: &Runner, name: &str, lesson: &Lesson) -> anyhow::Result<Vec<PathBuf>> {
        let mut page = format!("# {}\n\n{}\n{}\n", lesson.title, lesson.text[0], lesson.text[1]);
        for input in &lesson.input {
            write!(page, "\n*[{0}]({0}): {1}*\n\n```\n{2}\n```\n", input.file, input.caption, excerpt(&input.text))?;
        }
        for (figure, (_, typed)) in lesson.figure.iter().zip(&self.figures) {
            write!(page, "\n![{0}]({1})\n\n*{0}*\n\n    diopter {typed}\n", figure.caption, figure.file)?;
        }
        for (table, (text, typed)) in lesson.table.iter().zip(&self.tables) {
            write!(page, "\n*{}*\n\n    diopter {typed}\n\n```\n{}\n```\n", table.caption, text.trim_end())?;
        }
        let output = Output::prepare(&runner.folder.join(format!("{name}.md")))?;
        let mut files = self.inputs;
        files.extend(self.figures.into_iter().map(|f| f.0));
        files.push(output.commit(|to| Ok(to.write_all(page.as_bytes())?))?);
        Ok(files)
    }

    /// Appends the same to a document.
    fn print(self, lesson: &Lesson, book: &mut Document) -> anyhow::Result<()> {
        let blocks = &mut book.blocks;
        blocks.push(Block::Chapter(lesson.title.clone()));
        blocks.extend(lesson.text.iter().map(|line| Block::Paragraph(line.clone())));
        for input in &lesson.input {
            blocks.push(Block::Small(format!("{}: {}", input.file, input.caption)));
            blocks.push(Block::Fixed(excerpt(&input.text)));
        }
        for (figure, (path, typed)) in lesson.figure.iter().zip(self.figures) {
            let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
            blocks.push(Block::Picture { picture: paint::read_png(&bytes)?.into(), marked: None });
            blocks.push(Block::Paragraph(figure.caption.clone()));
            blocks.push(Block::Small(format!("diopter {typed}")));
        }
        for (table, (text, typed)) in lesson.table.iter().zip(self.tables) {
            blocks.push(Block::Paragraph(table.caption.clone()));
            blocks.push(Block::Small(format!("diopter {typed}")));
            blocks.push(Block::Fixed(text.trim_end().to_owned()));
        }
        Ok(())
    }
}

/// The beginning of a file, as a page shows it.
fn excerpt(text: &str) -> String {
    let lines: Vec<&str> = text.trim_end().lines().collect();
    match lines.len() > EXCERPT {
        true => format!("{}\n... {} more lines", lines[..EXCERPT].join("\n"), lines.len() - EXCERPT),
        false => lines.join("\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Verb;
    use crate::help;
    use diopter::lesson::words;
    use std::ffi::OsString;

    fn lessons() -> impl Iterator<Item = (&'static str, Lesson)> {
        LESSONS.iter().map(|(name, text)| (*name, Lesson::parse(text, name).unwrap_or_else(|e| panic!("{e}"))))
    }

    #[test]
    fn every_command_of_a_lesson_is_one_that_can_be_typed() {
        for (name, lesson) in lessons() {
            let commands = lesson.figure.iter().map(|f| &f.command).chain(lesson.table.iter().map(|t| &t.command));
            for command in commands {
                let typed: Vec<OsString> = ["diopter".to_owned()].into_iter().chain(words(command)).map(OsString::from).collect();
                let args = help::parse(&typed).unwrap_or_else(|e| panic!("{name}: {command}: {e}"));
                // Whatever is varied exists, too.
                if let Verb::Shoot(shoot) = args.verb {
                    let shot = shoot.taking.shot_file().unwrap();
                    let sheet = diopter::sheet::SheetFile { vary: shoot.vary.clone(), shot, ..Default::default() };
                    if !shoot.vary.is_empty() {
                        sheet.cells(None).unwrap_or_else(|e| panic!("{name}: {command}: {e}"));
                    }
                }
            }
        }
    }

    #[test]
    fn figures_are_written_where_the_page_shows_them() {
        let mut files = Vec::new();
        for (name, lesson) in lessons() {
            assert!(!lesson.figure.is_empty() || !lesson.table.is_empty(), "{name}");
            for input in &lesson.input {
                assert!(input.file.starts_with(name) && !input.text.trim().is_empty(), "{}", input.file);
                files.push(input.file.clone());
            }
            for figure in &lesson.figure {
                assert!(words(&figure.command).contains(&figure.file), "{name}: {}", figure.command);
                assert!(figure.file.ends_with(".png") && figure.file.starts_with(name), "{}", figure.file);
                files.push(figure.file.clone());
            }
        }
        let count = files.len();
        files.sort();
        files.dedup();
        assert_eq!(files.len(), count);
    }
}
