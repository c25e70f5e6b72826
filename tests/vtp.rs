//! The ParaView files are read back by a small reader of their own: header, offsets, blocks.
use braid_ecs::output::vtp::{DataArray, Polylines, Values, encode, write_series};
use glam::DVec3;
use std::collections::BTreeMap;
use std::io::Read;

/// Attribute `name` of an XML tag.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let start = tag.find(&format!(" {name}=\""))? + name.len() + 3;
    Some(&tag[start..start + tag[start..].find('"')?])
}

/// Arrays of a `.vtp` by name: (type, components, bytes).
fn read(file: &[u8]) -> (String, BTreeMap<String, (String, usize, Vec<u8>)>) {
    let mark = b"<AppendedData encoding=\"raw\">\n_";
    let at = file.windows(mark.len()).position(|w| w == mark).expect("appended section");
    let header = String::from_utf8(file[..at].to_vec()).expect("the header is text");
    let data = &file[at + mark.len()..];
    let word = |i: usize| u64::from_le_bytes(data[i..i + 8].try_into().unwrap()) as usize;
    let mut arrays = BTreeMap::new();
    for tag in header.split('<').filter(|t| t.starts_with("DataArray")) {
        let offset: usize = attribute(tag, "offset").unwrap().parse().unwrap();
        let (blocks, size, last) = (word(offset), word(offset + 8), word(offset + 16));
        let mut place = offset + 24 + 8 * blocks;
        let mut bytes = Vec::new();
        for b in 0..blocks {
            let packed = word(offset + 24 + 8 * b);
            let before = bytes.len();
            flate2::read::ZlibDecoder::new(&data[place..place + packed]).read_to_end(&mut bytes).unwrap();
            let expected = if b + 1 == blocks && last > 0 { last } else { size };
            assert_eq!(bytes.len() - before, expected, "block {b} of {tag}");
            place += packed;
        }
        let components = attribute(tag, "NumberOfComponents").unwrap().parse().unwrap();
        arrays.insert(attribute(tag, "Name").unwrap().to_owned(), (attribute(tag, "type").unwrap().to_owned(), components, bytes));
    }
    (header, arrays)
}

fn f64s(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|c| f64::from_le_bytes(*c)).collect()
}
fn f32s(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|c| f32::from_le_bytes(*c)).collect()
}
fn i64s(bytes: &[u8]) -> Vec<i64> {
    bytes.as_chunks::<8>().0.iter().map(|c| i64::from_le_bytes(*c)).collect()
}

/// `lines` helices of `n` points.
fn helices(lines: usize, n: usize) -> Polylines {
    let points: Vec<DVec3> = (0..lines * n)
        .map(|i| {
            let s = (i % n) as f64 * 0.1;
            DVec3::new((s + (i / n) as f64).cos(), (s + (i / n) as f64).sin(), s)
        })
        .collect();
    Polylines {
        point_data: vec![
            DataArray::scalars("radius", points.iter().map(|p| 0.01 + 0.001 * p.z)),
            DataArray::vectors("velocity", points.iter().map(|p| *p * 2.0)),
            DataArray::integers("tow", (0..points.len()).map(|i| (i / n) as i64)),
        ],
        line_data: vec![DataArray::integers("filament", 0..lines as i64)],
        field_data: vec![DataArray::text("provenance", "braid \"a\" <1 & 2>")],
        lengths: vec![n; lines],
        points,
    }
}

#[test]
fn arrays_come_back_from_the_file() {
    // 1 600 points: 38 400 bytes of coordinates, that is one full block and a partial one.
    let lines = helices(16, 100);
    let (header, arrays) = read(&encode(&lines, 0.125));
    assert!(header.contains("NumberOfPoints=\"1600\"") && header.contains("NumberOfLines=\"16\""));
    assert!(header.contains("header_type=\"UInt64\"") && header.contains("compressor=\"vtkZLibDataCompressor\""));
    assert_eq!(f64s(&arrays["Points"].2), lines.points.iter().flat_map(|p| p.to_array()).collect::<Vec<_>>());
    assert_eq!(arrays["Points"].1, 3);
    let Values::F32(radius) = &lines.point_data[0].values else { unreachable!() };
    assert_eq!(&f32s(&arrays["radius"].2), radius);
    assert_eq!((arrays["velocity"].1, f32s(&arrays["velocity"].2).len()), (3, 4800));
    assert_eq!(i64s(&arrays["tow"].2)[1599], 15);
    assert_eq!(i64s(&arrays["offsets"].2), (1..=16).map(|i| 100 * i).collect::<Vec<i64>>());
    assert_eq!(i64s(&arrays["connectivity"].2), (0..1600).collect::<Vec<i64>>());
    assert_eq!(f64s(&arrays["TimeValue"].2), [0.125]);
    assert_eq!(arrays["provenance"].0, "String");
    assert_eq!(arrays["provenance"].2, b"braid \"a\" <1 & 2>\0");
}

#[test]
fn a_whole_number_of_blocks_has_no_partial_one() {
    // 4 096 doubles are exactly one block of 32 768 bytes.
    let lines = Polylines {
        points: vec![DVec3::ZERO, DVec3::X],
        lengths: vec![2],
        field_data: vec![DataArray { name: "many".into(), components: 1, values: Values::F64(vec![1.5; 4096]) }],
        ..Default::default()
    };
    let (_, arrays) = read(&encode(&lines, 0.0));
    assert_eq!(f64s(&arrays["many"].2), vec![1.5; 4096]);
}

#[test]
fn the_series_lists_times_and_files() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("results.pvd");
    write_series(&path, &[(0.0, "frames/0000.vtp".into()), (1.5e-3, "frames/0001.vtp".into())], &[]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("timestep=\"0e0\" part=\"0\" file=\"frames/0000.vtp\""), "{text}");
    assert!(text.contains("timestep=\"1.5e-3\" part=\"0\" file=\"frames/0001.vtp\""), "{text}");
}
