//! Colour profiles, which are named but not applied.

/// A warning that a profile is not applied; none if it is that of sRGB.
pub(super) fn warning(profile: &[u8]) -> Option<String> {
    let name = description(profile);
    let is_srgb = |name: &str| {
        let name = name.to_ascii_lowercase();
        name.contains("srgb") || name.contains("61966") || name == "c2"
    };
    match name {
        Some(name) if is_srgb(&name) => None,
        Some(name) => Some(format!("the colour profile {name:?} is ignored")),
        None => Some("a colour profile without a name is ignored".into()),
    }
}

/// The text of the tag `desc`.
fn description(profile: &[u8]) -> Option<String> {
    let word = |at: usize| -> Option<usize> {
        let bytes: [u8; 4] = profile.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_be_bytes(bytes) as usize)
    };
    let count = word(128)?.min(100);
    let entry = (0..count).map(|k| 132 + 12 * k).find(|&at| profile.get(at..at + 4) == Some(b"desc"))?;
    let tag = profile.get(word(entry + 4)?..)?;
    let tag = tag.get(..word(entry + 8)?.min(4096)).unwrap_or(tag);
    let text: String = match tag.get(..4)? {
        b"desc" => tag.get(12..)?.iter().take_while(|&&b| b != 0).map(|&b| char::from(b)).collect(),
        b"mluc" => {
            let length = u32::from_be_bytes(tag.get(20..24)?.try_into().ok()?) as usize;
            let start = u32::from_be_bytes(tag.get(24..28)?.try_into().ok()?) as usize;
            let text = tag.get(start..)?;
            let text = text.get(..length).unwrap_or(text);
            char::decode_utf16(text.chunks_exact(2).map(|c| u16::from_be_bytes([c[0], c[1]]))).flatten().collect()
        }
        _ => return None,
    };
    Some(text.trim_matches('\0').chars().take(60).collect())
}
