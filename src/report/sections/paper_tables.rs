//! Tables 1 and 2 of the paper beside the same rows measured here.

use super::Section;
use crate::report::markup::{factor, number, table, three_digits};
use crate::report::paper::{Method, ROWS, TABLE_1, TABLE_2, measured};
use crate::report::sources::Sources;

/// `None` where no run has a preset of the tables.
pub(in crate::report) fn section(sources: &Sources) -> Option<Section> {
    let known = |methods: &[Method]| methods.iter().any(|m| here(sources, m).is_some());
    let mut html = String::new();
    if known(&TABLE_1) {
        html += "<h3>Table 1: the methods on one machine</h3><p class=\"note\">Paper: desktop with \
                 an NVIDIA GeForce GTX 780. Here: the machine of these runs. Milliseconds (median), \
                 FPS in frames a second. The factor is here over paper: above 1 the value is larger \
                 here.</p>";
        html += &times(sources, &TABLE_1);
        html += "<h3>What each step saves</h3><p class=\"note\">How many times faster the second \
                 method is than the first, each pair on its own machine: this is what can be \
                 compared.</p>";
        html += &ratios(sources);
    }
    if known(&TABLE_2) {
        html += "<h3>Table 2: small machines</h3><p class=\"note\">64<sup>3</sup> voxels and no \
                 D\u{2034}. Paper: PC with a GTX 780, notebook (NB) with a Quadro K2100M, tablet (M) \
                 with a GT640M LE. The factor is here over PC.</p>";
        html += &times(sources, &TABLE_2);
    }
    let title = "Stage times beside the paper\u{2019}s";
    (!html.is_empty()).then_some(Section { id: "tables", title, html })
}

fn here(sources: &Sources, method: &Method) -> Option<[f64; ROWS.len()]> {
    sources.timings_of(method.preset).map(measured)
}

/// For each method the paper's columns, ours, and ours over the first of the paper's.
fn times(sources: &Sources, methods: &[Method]) -> String {
    let mut groups = String::new();
    let mut heads = String::new();
    for method in methods {
        let span = method.columns.len() + 2;
        groups += &format!(
            "<th class=\"start\" colspan=\"{span}\" scope=\"colgroup\">{}</th>",
            method.name
        );
        for (i, column) in method.columns.iter().enumerate() {
            let class = if i == 0 { " class=\"start\"" } else { "" };
            heads += &format!("<th{class} scope=\"col\">{}</th>", column.name);
        }
        heads += "<th scope=\"col\">here</th><th scope=\"col\"></th>";
    }
    let mut body = String::new();
    for (row, name) in ROWS.iter().enumerate() {
        body += &format!("<tr><th scope=\"row\">{name}</th>");
        for method in methods {
            let measured = here(sources, method).map(|values| values[row]);
            for (i, column) in method.columns.iter().enumerate() {
                let class = if i == 0 { "start soft" } else { "soft" };
                body += &format!("<td class=\"{class}\">{}</td>", number(column.values[row], 2));
            }
            let ratio = measured.map(|m| m / method.columns[0].values[row]);
            body += &format!(
                "<td class=\"strong\">{}</td><td class=\"soft small\">{}</td>",
                three_digits(measured),
                factor(ratio)
            );
        }
        body += "</tr>";
    }
    format!(
        "<div class=\"scroll\"><table class=\"grouped\"><thead><tr><td></td>{groups}</tr>\
         <tr><td></td>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )
}

/// First and second of each pair, by their place in Table 1.
const PAIRS: [(usize, usize); 3] = [(0, 1), (1, 3), (2, 3)];

fn ratios(sources: &Sources) -> String {
    let mut head = vec![String::new()];
    for (a, b) in PAIRS {
        let pair = format!("{} \u{2192} {}", TABLE_1[a].name, TABLE_1[b].name);
        head.extend([format!("{pair}, paper"), "here".to_owned()]);
    }
    let rows: Vec<Vec<String>> = (0..ROWS.len()).map(|row| ratio_row(sources, row)).collect();
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows, 1)
}

fn ratio_row(sources: &Sources, row: usize) -> Vec<String> {
    let faster = |a: f64, b: f64| if ROWS[row] == "FPS" { b / a } else { a / b };
    let mut cells = vec![ROWS[row].to_owned()];
    for (a, b) in PAIRS {
        let [a, b] = [TABLE_1[a], TABLE_1[b]];
        let paper = faster(a.columns[0].values[row], b.columns[0].values[row]);
        let own = here(sources, &a).zip(here(sources, &b)).map(|(a, b)| faster(a[row], b[row]));
        // a stage that takes no time in one of them says nothing
        let sensible = |ratio: f64| factor(Some(ratio).filter(|r| *r > 0.0));
        cells.push(sensible(paper));
        cells.push(format!("<b>{}</b>", own.map_or(factor(None), sensible)));
    }
    cells
}
