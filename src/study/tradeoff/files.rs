//! `study.json`, `points.csv`, `summary.md`.

use super::{ErrorKind, TradePoint, Tradeoff};
use crate::output::{OutputError, atomic_write, csv_field};
use crate::timing::Stage;
use std::fmt::Write as _;
use std::path::Path;

impl Tradeoff {
    /// Writes all three into `folder`. The front must be marked, by `kind`.
    pub fn write(&self, folder: &Path, kind: ErrorKind) -> Result<(), OutputError> {
        let json = serde_json::to_vec_pretty(self).expect("a study is plain data");
        let (csv, summary) = (self.csv(), self.summary(kind));
        for (name, bytes) in [
            ("study.json", json.as_slice()),
            ("points.csv", csv.as_bytes()),
            ("summary.md", summary.as_bytes()),
        ] {
            atomic_write(&folder.join(name), |out| out.write_all(bytes))?;
        }
        Ok(())
    }

    /// A line a point. What was not measured is empty.
    pub fn csv(&self) -> String {
        let stages = Stage::ALL.map(Stage::name).join(",");
        let mut csv = format!(
            "name,preset,changes,update_ms,{stages},light_angle_deg,light_relative_l2,\
             transfer_error,composite_error,volume_mib,on_front\n"
        );
        for p in &self.points {
            let stages = Stage::ALL
                .map(|s| p.stage_ms.get(s.name()).map_or(String::new(), |ms| format!("{ms:.3}")));
            let errors =
                [p.light_angle_deg, p.light_relative_l2, p.transfer_error, p.composite_error]
                    .map(|error| error.map_or(String::new(), |e| format!("{e:.6}")));
            csv += &format!(
                "{},{},{},{:.3},{},{},{:.2},{}\n",
                csv_field(&p.name),
                csv_field(&p.preset),
                csv_field(&p.changes.join("; ")),
                p.update_ms,
                stages.join(","),
                errors.join(","),
                p.volume_mib,
                p.on_front
            );
        }
        csv
    }

    /// The front as a table, fastest first, with `ours` and `ours-fast` beside it.
    pub fn summary(&self, kind: ErrorKind) -> String {
        let m = &self.machine;
        let mut text = format!(
            "# Time against error\n\n{}, {} threads, {}, kinlight {}. `{}`\n\n\
             {} settings measured; {} are on the front of update time and {} error: no other is \
             as good in both and better in one.\n\n\
             | setting | update ms | {} error | light angle | volume MiB | |\n\
             | --- | --- | --- | --- | --- | --- |\n",
            m.cpu,
            m.threads,
            m.backend,
            m.version,
            self.command,
            self.points.len(),
            self.front().len(),
            kind.name(),
            kind.name(),
        );
        let is_preset = |p: &TradePoint| p.changes.is_empty();
        let mut rows: Vec<_> = self.points.iter().filter(|p| p.on_front || is_preset(p)).collect();
        rows.sort_by(|a, b| a.update_ms.total_cmp(&b.update_ms));
        for p in rows {
            let angle = p.light_angle_deg.map_or("-".into(), |a| format!("{a:.1} deg"));
            let error = kind.of(p).map_or("-".into(), |e| format!("{e:.4}"));
            let front = if p.on_front { "on the front" } else { "" };
            let _ = writeln!(
                // a String takes everything
                text,
                "| {} | {:.1} | {error} | {angle} | {:.0} | {front} |",
                p.name,
                p.update_ms,
                p.volume_mib
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Machine;

    fn study() -> Tradeoff {
        let point = |name: &str, update_ms, error: Option<f64>| TradePoint {
            name: name.to_owned(),
            preset: "ours".to_owned(),
            changes: vec!["transfer.directions=16".to_owned(), "light.stride=4".to_owned()],
            stage_ms: [("Surface".to_owned(), 2.5)].into(),
            update_ms,
            light_angle_deg: None,
            light_relative_l2: None,
            transfer_error: None,
            composite_error: error,
            volume_mib: 10.0,
            on_front: false,
        };
        let mut study = Tradeoff {
            machine: Machine::here(),
            command: "kinlight tradeoff".to_owned(),
            sequences: vec!["a".to_owned()],
            warm_up: 10,
            points: vec![
                point("slow, good", 300.0, Some(0.1)),
                point("fast", 90.0, Some(0.2)),
                point("neither", 400.0, Some(0.3)),
                point("unknown", 1.0, None),
            ],
        };
        study.mark_front(ErrorKind::Composite);
        study
    }

    #[test]
    fn the_front_is_in_every_file() {
        let folder = tempfile::tempdir().unwrap();
        let study = study();
        assert_eq!(ErrorKind::first_of(&study.points), Some(ErrorKind::Composite));
        study.write(folder.path(), ErrorKind::Composite).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let back: Tradeoff = serde_json::from_str(&read("study.json")).unwrap();
        assert_eq!(back, study);
        assert_eq!(
            back.front().iter().map(|p| &p.name[..]).collect::<Vec<_>>(),
            ["fast", "slow, good"]
        );
        let csv = read("points.csv");
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines.len(), 5);
        assert!(lines[1].starts_with(
            "\"slow, good\",ours,transfer.directions=16; light.stride=4,300.000,,,2.500,"
        ));
        assert!(lines[1].ends_with(",,,,0.100000,10.00,true"), "{}", lines[1]);
        assert!(lines[4].ends_with(",,,,,10.00,false"), "{}", lines[4]);
        let columns = |line: &str| line.matches(',').count();
        assert_eq!(columns(lines[0]), columns(lines[2]));
        let summary = read("summary.md");
        let at = |name: &str| summary.find(name);
        assert!(at("| fast |") < at("| slow, good |") && at("| fast |").is_some());
        assert!(at("neither").is_none() && summary.contains("4 settings measured; 2 are"));
    }
}
