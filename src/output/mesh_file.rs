//! `mesh.ply`: a triangle mesh in binary little-endian PLY.

use super::{OutputError, atomic_write};
use crate::mesh::TriangleMesh;
use std::io::{self, Write};
use std::path::Path;

/// Writes positions in metres, normals and 8-bit sRGB colours where the mesh has them, and
/// triangles as `vertex_indices`.
pub fn write_ply(path: &Path, mesh: &TriangleMesh) -> Result<(), OutputError> {
    check(mesh).map_err(|problem| OutputError::content(path, problem))?;
    atomic_write(path, |w| {
        w.write_all(header(mesh).as_bytes())?;
        write_vertices(w, mesh)?;
        for triangle in &mesh.triangles {
            w.write_all(&[3])?;
            w.write_all(triangle.map(u32::to_le_bytes).as_flattened())?;
        }
        Ok(())
    })
}

fn check(mesh: &TriangleMesh) -> Result<(), String> {
    let vertices = mesh.positions.len();
    for (what, n) in [("normals", mesh.normals.len()), ("colors", mesh.colors.len())] {
        if n != 0 && n != vertices {
            return Err(format!("a mesh of {vertices} vertices has {n} {what}"));
        }
    }
    // PLY readers take indices as 32-bit signed numbers
    if vertices > i32::MAX as usize {
        return Err(format!("{vertices} vertices are too many for PLY"));
    }
    match mesh.triangles.iter().flatten().find(|&&v| v as usize >= vertices) {
        Some(v) => Err(format!("a triangle names vertex {v} of {vertices}")),
        None => Ok(()),
    }
}

fn header(mesh: &TriangleMesh) -> String {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n",
        mesh.positions.len()
    );
    if !mesh.normals.is_empty() {
        header += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if !mesh.colors.is_empty() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    header += &format!(
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.triangles.len()
    );
    header
}

fn write_vertices(w: &mut dyn Write, mesh: &TriangleMesh) -> io::Result<()> {
    for (i, position) in mesh.positions.iter().enumerate() {
        w.write_all(position.map(f32::to_le_bytes).as_flattened())?;
        if let Some(normal) = mesh.normals.get(i) {
            w.write_all(normal.map(f32::to_le_bytes).as_flattened())?;
        }
        if let Some(color) = mesh.colors.get(i) {
            w.write_all(color)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads by what the header says, whatever order the properties are in.
    fn read(bytes: &[u8]) -> TriangleMesh {
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let header = std::str::from_utf8(&bytes[..at]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        let mut body = &bytes[at..];
        fn take<const N: usize>(body: &mut &[u8]) -> [u8; N] {
            let (head, rest) = body.split_first_chunk().unwrap();
            *body = rest;
            *head
        }
        let mut mesh = TriangleMesh::default();
        let words: Vec<Vec<&str>> = header.lines().map(|l| l.split(' ').collect()).collect();
        let count = |element: &str| -> usize {
            words.iter().find(|w| w[0] == "element" && w[1] == element).unwrap()[2].parse().unwrap()
        };
        let faces_from = words.iter().position(|w| w.get(1) == Some(&"face")).unwrap();
        for _ in 0..count("vertex") {
            let (mut p, mut n, mut c) = ([0.0; 3], [0.0; 3], [0u8; 3]);
            for property in words[..faces_from].iter().filter(|w| w[0] == "property") {
                let find = |names: [&str; 3]| names.iter().position(|n| *n == property[2]);
                if let Some(i) = find(["x", "y", "z"]) {
                    p[i] = f32::from_le_bytes(take(&mut body));
                } else if let Some(i) = find(["nx", "ny", "nz"]) {
                    n[i] = f32::from_le_bytes(take(&mut body));
                } else if let Some(i) = find(["red", "green", "blue"]) {
                    assert_eq!(property[1], "uchar");
                    [c[i]] = take(&mut body);
                } else {
                    panic!("{property:?}");
                }
            }
            mesh.positions.push(p);
            if header.contains("property float nx\n") {
                mesh.normals.push(n);
            }
            if header.contains("property uchar red\n") {
                mesh.colors.push(c);
            }
        }
        assert_eq!(words[faces_from + 1], ["property", "list", "uchar", "int", "vertex_indices"]);
        for _ in 0..count("face") {
            assert_eq!(take(&mut body), [3u8]);
            mesh.triangles.push(std::array::from_fn(|_| u32::from_le_bytes(take(&mut body))));
        }
        assert!(body.is_empty(), "{} bytes too many", body.len());
        mesh
    }

    fn mesh() -> TriangleMesh {
        TriangleMesh {
            positions: vec![[0.0, 1.5, -2.0], [1.0, 0.0, 0.0], [0.25, 3.0, 1e-9], [7.0, 8.0, 9.0]],
            normals: vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.8, 0.0]],
            colors: vec![[255, 0, 1], [10, 13, 26], [3, 2, 1], [4, 5, 6]],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
        }
    }

    #[test]
    fn meshes_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        let full = mesh();
        let plain = TriangleMesh { normals: vec![], colors: vec![], ..mesh() };
        let coloured = TriangleMesh { normals: vec![], ..mesh() };
        for mesh in [full, plain, coloured, TriangleMesh::default()] {
            write_ply(&path, &mesh).unwrap();
            assert_eq!(read(&std::fs::read(&path).unwrap()), mesh);
        }
    }

    #[test]
    fn inconsistent_meshes_are_refused() {
        let path = Path::new("mesh.ply");
        let few = TriangleMesh { normals: vec![[0.0; 3]; 3], ..mesh() };
        let message = write_ply(path, &few).unwrap_err().to_string();
        assert_eq!(message, "mesh.ply: a mesh of 4 vertices has 3 normals");
        let wild = TriangleMesh { triangles: vec![[0, 1, 4]], ..mesh() };
        let message = write_ply(path, &wild).unwrap_err().to_string();
        assert_eq!(message, "mesh.ply: a triangle names vertex 4 of 4");
        assert!(!path.exists());
    }
}
