//! Tables 1 and 2 of Gruber, Ventura, Schmalstieg 2015: frames a second, then milliseconds.

use crate::output::TimingSummary;
use crate::timing::Stage;

/// Rows of both tables: FPS, Update and the stages in the order of [`Stage::ALL`].
pub(super) const ROWS: [&str; 9] = [
    "FPS",
    "Update",
    "Input",
    "Reconstruct",
    "Surface",
    "DynGeo",
    "RadTransfer",
    "LightEst",
    "Rendering",
];

/// One column of the paper.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    pub name: &'static str,
    pub values: [f64; ROWS.len()],
}

/// A method of the paper and the preset that does the same here.
#[derive(Clone, Copy, Debug)]
pub(super) struct Method {
    pub name: &'static str,
    pub preset: &'static str,
    /// A column for each machine.
    pub columns: &'static [Column],
}

/// On a desktop computer with an NVIDIA GeForce GTX 780.
pub(super) const TABLE_1: [Method; 4] = [
    Method {
        name: "GR12",
        preset: "gr12",
        columns: &[Column {
            name: "paper",
            values: [5.8, 172.45, 7.3, 11.1, 6.69, 0.0, 130.48, 3.86, 0.92],
        }],
    },
    Method {
        name: "Ours",
        preset: "ours",
        columns: &[Column {
            name: "paper",
            values: [13.98, 71.5, 7.06, 10.9, 12.57, 1.19, 36.22, 2.67, 0.86],
        }],
    },
    Method {
        name: "GR14",
        preset: "gr14",
        columns: &[Column {
            name: "paper",
            values: [12.29, 81.36, 7.44, 10.24, 6.69, 0.0, 50.54, 5.27, 0.98],
        }],
    },
    Method {
        name: "OursFast",
        preset: "ours-fast",
        columns: &[Column {
            name: "paper",
            values: [22.46, 44.53, 7.02, 10.64, 12.6, 1.02, 10.5, 1.8, 0.87],
        }],
    },
];

/// PC as in Table 1, a notebook (NB, Quadro K2100M) and a tablet (M, GT640M LE); 64^3 voxels, no D'''.
pub(super) const TABLE_2: [Method; 2] = [
    Method {
        name: "Ours",
        preset: "ours-mobile",
        columns: &[
            Column { name: "PC", values: [18.24, 54.8, 0.8, 9.42, 5.28, 1.27, 34.57, 2.56, 0.89] },
            Column {
                name: "NB",
                values: [3.23, 309.86, 0.86, 37.68, 30.73, 18.25, 214.27, 4.56, 3.52],
            },
            Column {
                name: "M",
                values: [2.19, 456.78, 1.29, 66.0, 45.68, 25.77, 314.68, 1.98, 1.36],
            },
        ],
    },
    Method {
        name: "OursFast",
        preset: "ours-fast-mobile",
        columns: &[
            Column { name: "PC", values: [33.6, 29.76, 0.79, 9.42, 5.28, 1.12, 9.96, 1.93, 1.24] },
            Column {
                name: "NB",
                values: [7.34, 136.24, 0.81, 36.86, 30.02, 17.89, 38.69, 8.52, 3.43],
            },
            Column {
                name: "M",
                values: [5.0, 200.48, 0.9, 66.16, 44.99, 25.75, 59.17, 2.24, 1.26],
            },
        ],
    },
];

/// The same rows of a run.
pub(super) fn measured(timings: &TimingSummary) -> [f64; ROWS.len()] {
    let mut values = [timings.fps, timings.update.median_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for (value, stage) in values[2..].iter_mut().zip(Stage::ALL) {
        *value = timings.stage(stage).median_ms;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_the_stages() {
        assert_eq!(ROWS[2..], Stage::ALL.map(Stage::name));
    }

    /// The paper's numbers agree with each other up to its own slips: guards against typing errors.
    #[test]
    fn columns_are_consistent() {
        for method in TABLE_1.iter().chain(&TABLE_2) {
            for column in method.columns {
                let [fps, update, stages @ ..] = column.values;
                assert!((fps * update / 1000.0 - 1.0).abs() < 0.01, "{method:?}");
                let sum: f64 = stages.iter().sum();
                // "Update" has what lies between the stages too: 0.05 to 12 ms of it are printed
                assert!((-0.1..12.2).contains(&(update - sum)), "{} {}", method.name, update - sum);
            }
        }
    }
}
