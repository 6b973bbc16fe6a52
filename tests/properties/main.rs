//! What holds for any input: identities, symmetries and round trips, tried on random cases.

mod arbitrary;
mod files;
mod harmonics;
mod light;
mod maps;
mod poses;
