//! The table of faults, as Markdown.

use std::fs::OpenOptions;
use std::io::Write;
use std::sync::Mutex;

/// Names the file that gets what is measured.
const FILE: &str = "KINLIGHT_FAULT_TABLE";

/// One fault through one command.
pub struct Row {
    pub fault: String,
    pub command: &'static str,
    /// Lines of standard error, as they are.
    pub sees: Vec<String>,
    pub exit: i32,
    /// From the fault to the next frame that the sensor gives, by the sensor's log.
    pub recovery_ms: Option<f64>,
    pub frames: String,
    /// From the interrupt to the end of the process.
    pub stop_s: Option<f64>,
}

const HEAD: &str = "| fault | command | what the user sees | exit | recovery | frames | stop |\n\
                    | --- | --- | --- | --- | --- | --- | --- |\n";

impl Row {
    fn line(&self) -> String {
        let cell = |text: &String| format!("`{}`", text.trim().replace('|', "\\|"));
        let sees: Vec<String> = self.sees.iter().map(cell).collect();
        let sees = if sees.is_empty() { "nothing".to_owned() } else { sees.join("<br>") };
        let recovery = self.recovery_ms.map_or("-".into(), |ms| format!("{ms:.0} ms"));
        let stop = self.stop_s.map_or("-".into(), |s| format!("{s:.2} s"));
        let (fault, command, exit, frames) = (&self.fault, self.command, self.exit, &self.frames);
        format!("| {fault} | {command} | {sees} | {exit} | {recovery} | {frames} | {stop} |\n")
    }
}

pub fn markdown(rows: &[Row]) -> String {
    rows.iter().fold(HEAD.to_owned(), |table, row| table + &row.line())
}

/// Prints a part of the results, and adds it to the file that is asked for.
pub fn publish(text: &str) {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _one = ONE_AT_A_TIME.lock();
    println!("{text}");
    if let Some(path) = std::env::var_os(FILE) {
        let mut file = OpenOptions::new().create(true).append(true).open(path).unwrap();
        writeln!(file, "{text}").unwrap();
    }
}
