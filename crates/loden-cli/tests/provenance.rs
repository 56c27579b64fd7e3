//! Files say what they were made from, by which program, and whether they are whole.

use std::fs;

use crate::common::{failure, json, loden, text, workshop};

#[test]
fn a_compressed_file_says_what_it_was_made_from() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 3 -o a.loden");
    json(at, "compress small.zip --method pvmf --components 3 -o b.loden --threads 1");
    assert_eq!(fs::read(at.join("a.loden")).unwrap(), fs::read(at.join("b.loden")).unwrap());
    let info = json(at, "info a.loden");
    let sum = std::process::Command::new("sha256sum").arg(at.join("small.zip")).output().unwrap();
    assert_eq!(info["source"]["name"], "small.zip");
    assert_eq!(info["source"]["sha256"].as_str(), text(&sum.stdout).split(' ').next());
    assert_eq!(info["program"], concat!("loden ", env!("CARGO_PKG_VERSION")));
    // another file of the same content is the same source, whatever its name
    fs::copy(at.join("small.zip"), at.join("renamed.zip")).unwrap();
    let warnings = |source: &str| text(&loden(at, &format!("compare {source} a.loden --json")).stderr);
    assert_eq!(warnings("small.zip"), "");
    assert_eq!(warnings("renamed.zip"), "");
    json(at, "convert small.zip other.zip --quality 50");
    let warning = warnings("other.zip");
    let expected =
        "warning: a.loden was compressed from another source: the content of its small.zip is not that of other.zip";
    assert!(warning.contains(expected), "{warning}");
}

/// The places of the tensors in a file.
fn tensors(file: &[u8]) -> Vec<(String, std::ops::Range<usize>)> {
    let length = u64::from_le_bytes(file[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&file[8..8 + length]).unwrap();
    let tensors = header.as_object().unwrap().iter().filter(|(name, _)| *name != "__metadata__");
    let place =
        |tensor: &serde_json::Value, i: usize| 8 + length + tensor["data_offsets"][i].as_u64().unwrap() as usize;
    tensors.map(|(name, tensor)| (name.clone(), place(tensor, 0)..place(tensor, 1))).collect()
}

#[test]
fn a_flipped_bit_of_any_tensor_is_found() {
    let dir = workshop();
    let at = dir.path();
    for codec in loden::codec::CODECS {
        json(at, &format!("compress small.zip --method {} -o x.loden --no-error", codec.name()));
        let whole = fs::read(at.join("x.loden")).unwrap();
        for (name, place) in tensors(&whole) {
            for byte in [place.start, (place.start + place.end) / 2, place.end - 1] {
                let mut damaged = whole.clone();
                damaged[byte] ^= 1;
                fs::write(at.join("damaged.loden"), damaged).unwrap();
                let message = failure(at, "info damaged.loden", 1);
                let expected = format!("damaged.loden: tensor {name}: its bytes are damaged");
                assert!(message.contains(&expected), "{} byte {byte}: {message}", codec.name());
            }
        }
    }
}
