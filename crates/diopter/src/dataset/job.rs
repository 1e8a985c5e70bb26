//! A data set as a job of render farms: a template of Open Job Description (version 2023-09 of its specification, "Template Schemas"), which `openjd` and
//! AWS Deadline Cloud run.
//!
//! Two steps: tasks that make some items each and leave them in the folder, and one that packs them when all are there. Tasks are pure: a scheduler may
//! repeat them, on any machine that sees the folder.

use super::Dataset;
use serde_json::json;

/// What a task gets.
#[derive(Clone, Debug, PartialEq)]
pub struct Hints {
    /// Items of a task.
    pub items: u64,
    /// Processor cores.
    pub cores: Option<u32>,
    /// Memory, MiB.
    pub memory_mib: Option<u64>,
    /// Longest time of a task, s.
    pub timeout_s: Option<u64>,
}

/// Longest name of a job: so says the specification.
const MOST_NAME: usize = 128;

/// The template, as YAML. `specification` and `folder` are defaults of the job's parameters, relative to the template and not above it, as the
/// specification of templates demands; without, whoever submits the job gives them.
pub fn template(dataset: &Dataset, specification: Option<&str>, folder: Option<&str>, hints: &Hints) -> String {
    let quoted = |text: &str| json!(text).to_string();
    let default = |path: Option<&str>| path.map_or(String::new(), |p| format!("    default: {}\n", quoted(p)));
    let arguments = |list: &[String]| list.iter().map(|a| quoted(a)).collect::<Vec<_>>().join(", ");
    let name: String = format!("data set {}", dataset.name()).chars().filter(|c| !c.is_control()).take(MOST_NAME).collect();
    // Braces would be an expression.
    let name = name.replace("{{", "{ {");
    let per_task = hints.items.clamp(1, dataset.items());
    let last = (dataset.items() - 1) / per_task * per_task;
    let range = if last == 0 { "0".to_owned() } else { format!("0-{last}:{per_task}") };
    let threads = hints.cores.map(|c| vec!["--threads".to_owned(), c.to_string()]).unwrap_or_default();
    let items = [
        &["dataset", "item", "{{Param.Specification}}", "--item", "{{Task.Param.First}}", "--count"].map(str::to_owned)[..],
        &[per_task.to_string()],
        &["-o", "{{Param.Folder}}"].map(str::to_owned),
        &threads,
    ]
    .concat();
    let pack =
        [&["dataset", "make", "{{Param.Specification}}", "-o", "{{Param.Folder}}"].map(str::to_owned)[..], &threads].concat();
    let timeout = hints.timeout_s.map_or(String::new(), |s| format!("          timeout: {}\n", s.max(1)));
    let mut amounts = String::new();
    if let Some(cores) = hints.cores {
        amounts.push_str(&format!("        - name: amount.worker.vcpu\n          min: {}\n", cores.max(1)));
    }
    if let Some(mib) = hints.memory_mib {
        amounts.push_str(&format!("        - name: amount.worker.memory\n          min: {}\n", mib.max(1)));
    }
    let requirements =
        if amounts.is_empty() { String::new() } else { format!("    hostRequirements:\n      amounts:\n{amounts}") };
    format!(
        "specificationVersion: jobtemplate-2023-09\n\
         name: {name}\n\
         parameterDefinitions:\n\
         \x20 - name: Specification\n\
         \x20   type: PATH\n\
         \x20   objectType: FILE\n\
         \x20   dataFlow: IN\n\
         \x20   description: What varies and what is written.\n\
         {specification}\
         \x20 - name: Folder\n\
         \x20   type: PATH\n\
         \x20   objectType: DIRECTORY\n\
         \x20   dataFlow: OUT\n\
         \x20   description: Where the data set is gathered; all workers see it.\n\
         {folder}\
         \x20 - name: Program\n\
         \x20   type: STRING\n\
         \x20   description: The program diopter, as workers find it.\n\
         \x20   default: diopter\n\
         steps:\n\
         \x20 - name: Items\n\
         \x20   parameterSpace:\n\
         \x20     taskParameterDefinitions:\n\
         \x20       - name: First\n\
         \x20         type: INT\n\
         \x20         range: {range}\n\
         {requirements}\
         \x20   script:\n\
         \x20     actions:\n\
         \x20       onRun:\n\
         \x20         command: \"{{{{Param.Program}}}}\"\n\
         \x20         args: [{items}]\n\
         {timeout}\
         \x20 - name: Pack\n\
         \x20   dependencies:\n\
         \x20     - dependsOn: Items\n\
         {requirements}\
         \x20   script:\n\
         \x20     actions:\n\
         \x20       onRun:\n\
         \x20         command: \"{{{{Param.Program}}}}\"\n\
         \x20         args: [{pack}]\n",
        name = quoted(&name),
        specification = default(specification),
        folder = default(folder),
        range = quoted(&range),
        items = arguments(&items),
        pack = arguments(&pack),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn of(items: u64, hints: &Hints) -> String {
        let set = Dataset::new(&format!("name = \"a set\"\nitems = {items}"), "spec.toml", Path::new("")).unwrap();
        template(&set, Some("sets/spec.toml"), None, hints)
    }

    #[test]
    fn tasks_cover_all_items_once() {
        let plain = |items: u64| Hints { items, cores: None, memory_mib: None, timeout_s: None };
        assert!(of(200, &plain(16)).contains("range: \"0-192:16\""));
        assert!(of(192, &plain(16)).contains("range: \"0-176:16\""));
        assert!(of(5, &plain(16)).contains("range: \"0\"") && of(5, &plain(16)).contains("\"--count\", \"5\""));
        let text = of(200, &Hints { items: 16, cores: Some(2), memory_mib: Some(2000), timeout_s: Some(600) });
        for line in [
            "specificationVersion: jobtemplate-2023-09\nname: \"data set a set\"\n",
            "    default: \"sets/spec.toml\"\n  - name: Folder\n",
            "          command: \"{{Param.Program}}\"\n",
            "          timeout: 600\n",
            "        - name: amount.worker.memory\n          min: 2000\n",
            "\"--item\", \"{{Task.Param.First}}\", \"--count\", \"16\", \"-o\", \"{{Param.Folder}}\", \"--threads\", \"2\"]",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert!(!of(5, &plain(1)).contains("hostRequirements"));
    }
}
