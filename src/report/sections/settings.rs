//! What the results were made with.

use super::Section;
use crate::report::markup::{escape, table};
use crate::report::sources::Sources;
use crate::study::Machine;
use std::collections::{BTreeMap, BTreeSet};

pub(in crate::report) fn section(sources: &Sources) -> Section {
    let html = machines(sources) + &commands(sources) + &settings(sources);
    Section { id: "settings", title: "Settings, machine, commands", html }
}

/// What a result lies in, its machine, and its command.
fn origins(sources: &Sources) -> Vec<(String, &Machine, &str)> {
    let folder = |path: &std::path::Path| path.display().to_string();
    let runs = sources.runs.iter().filter_map(|run| {
        let made_by = run.made_by.as_ref()?;
        Some((folder(&run.folder), &made_by.machine, made_by.command.as_str()))
    });
    let light = sources.light.iter();
    let light = light.map(|f| (folder(&f.folder), &f.record.machine, f.record.command.as_str()));
    let composite = sources.composite.iter();
    let composite =
        composite.map(|f| (folder(&f.folder), &f.record.machine, f.record.command.as_str()));
    let tradeoff = sources.tradeoff.iter();
    let tradeoff =
        tradeoff.map(|f| (folder(&f.folder), &f.record.machine, f.record.command.as_str()));
    runs.chain(light).chain(composite).chain(tradeoff).collect()
}

fn machines(sources: &Sources) -> String {
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (_, m, _) in origins(sources) {
        let row = [&m.cpu, &m.threads.to_string(), &m.system, &m.backend, &m.version]
            .map(|text| escape(text))
            .to_vec();
        if !rows.contains(&row) {
            rows.push(row);
        }
    }
    match rows.is_empty() {
        true => String::new(),
        false => table(&["Machine", "threads", "system", "backend", "kinlight"], &rows, 1),
    }
}

fn commands(sources: &Sources) -> String {
    let mut html = String::new();
    let mut said = BTreeSet::new();
    for (folder, _, command) in origins(sources) {
        if said.insert(command) {
            html +=
                &format!("<p class=\"note\">{}</p><pre>{}</pre>", escape(&folder), escape(command));
        }
    }
    html
}

fn settings(sources: &Sources) -> String {
    let runs: Vec<(&str, BTreeMap<String, String>)> = sources
        .runs
        .iter()
        .filter_map(|run| Some((run.name.as_str(), flat(run.settings.as_ref()?))))
        .collect();
    let mut html = difference_table(&runs);
    for run in &sources.runs {
        if let Some(settings) = &run.settings {
            html += &format!(
                "<details><summary>All settings of {}</summary><pre>{}</pre></details>",
                escape(&run.name),
                escape(&settings.to_string())
            );
        }
    }
    html
}

/// Fields in which the runs differ.
fn difference_table(runs: &[(&str, BTreeMap<String, String>)]) -> String {
    let keys: BTreeSet<&String> = runs.iter().flat_map(|(_, fields)| fields.keys()).collect();
    let rows: Vec<Vec<String>> = keys
        .into_iter()
        .filter(|key| runs.windows(2).any(|pair| pair[0].1.get(*key) != pair[1].1.get(*key)))
        .map(|key| {
            let value = |fields: &BTreeMap<String, String>| {
                fields.get(key).map_or("–".to_owned(), |v| escape(v))
            };
            let name = format!("<code>{}</code>", escape(key));
            std::iter::once(name).chain(runs.iter().map(|(_, f)| value(f))).collect()
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut head = vec!["Settings that differ".to_owned()];
    head.extend(runs.iter().map(|(name, _)| escape(name)));
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows, 1)
}

/// Dotted names and values.
fn flat(table: &toml::Table) -> BTreeMap<String, String> {
    let mut fields = BTreeMap::new();
    let mut open: Vec<(String, &toml::Table)> = vec![(String::new(), table)];
    while let Some((prefix, table)) = open.pop() {
        for (key, value) in table {
            let name = format!("{prefix}{key}");
            match value {
                toml::Value::Table(inner) => open.push((name + ".", inner)),
                // written in full, 0.05 is 0.05000000074505806
                toml::Value::Float(v) => drop(fields.insert(name, (*v as f32).to_string())),
                value => drop(fields.insert(name, value.to_string())),
            }
        }
    }
    fields
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_differs_is_in_the_table() {
        let settings = |text: &str| flat(&text.parse::<toml::Table>().unwrap());
        let a = settings("[a]\nx = 1\ny = 0.05\n[a.b]\nz = \"<q>\"");
        let b = settings("[a]\nx = 2\ny = 0.05\n");
        assert_eq!(a.keys().collect::<Vec<_>>(), ["a.b.z", "a.x", "a.y"]);
        let html = difference_table(&[("one", a.clone()), ("two", b)]);
        assert!(html.contains("a.x") && html.contains("a.b.z") && !html.contains("a.y"), "{html}");
        assert!(roxmltree::Document::parse(&html).is_ok());
        assert_eq!(difference_table(&[("one", a)]), "");
    }
}
