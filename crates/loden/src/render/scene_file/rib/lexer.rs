//! Tokens of RIB files, ASCII or binary.

use std::collections::HashMap;

/// A token.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    /// The name of a request.
    Request(String),
    Number(f32),
    Text(String),
    Open,
    Close,
}

/// Splits a file into tokens.
///
/// # Model
/// ASCII and binary encoding may be mixed. Comments and structure hints begin with `#` and are skipped.
///
/// # References
/// pixar2000 (appendix C.2)
pub(super) struct Lexer {
    bytes: Vec<u8>,
    at: usize,
    line: usize,
    /// Strings and request names defined by the binary encoding, by code.
    strings: HashMap<u16, String>,
    requests: HashMap<u8, String>,
    /// Numbers left in the encoded array being read.
    array: Option<usize>,
}

type Lexed<T> = Result<T, String>;

impl Lexer {
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        // skip a byte order mark
        let at = if bytes.starts_with(&[0xef, 0xbb, 0xbf]) { 3 } else { 0 };
        Self { bytes, at, line: 1, strings: HashMap::new(), requests: HashMap::new(), array: None }
    }

    /// The line of the last token, counted from 1.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// The next token; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Lexed<Option<Token>> {
        if let Some(left) = self.array {
            self.array = left.checked_sub(1);
            return Ok(Some(if left == 0 { Token::Close } else { Token::Number(f32::from_be_bytes(self.take()?)) }));
        }
        loop {
            let Some(&byte) = self.bytes.get(self.at) else { return Ok(None) };
            self.at += 1;
            match byte {
                b'\n' => self.line += 1,
                // lines may end as on old Macintoshes
                b'\r' => self.line += usize::from(self.bytes.get(self.at) != Some(&b'\n')),
                b' ' | b'\t' | 0x0b | 0x0c | 0 => {}
                b'#' => {
                    while self.bytes.get(self.at).is_some_and(|&b| b != b'\n' && b != b'\r') {
                        self.at += 1;
                    }
                }
                b'[' => return Ok(Some(Token::Open)),
                b']' => return Ok(Some(Token::Close)),
                b'"' | b'\'' => return self.quoted(byte).map(|text| Some(Token::Text(text))),
                b'+' | b'-' | b'.' | b'0'..=b'9' => return self.number().map(Some),
                b'a'..=b'z' | b'A'..=b'Z' => {
                    let word = self.run(|b| b.is_ascii_alphanumeric() || b == b'_');
                    return Ok(Some(Token::Request(word)));
                }
                0o200.. => {
                    if byte == 0o377 {
                        self.at = self.bytes.len();
                    } else if let Some(token) = self.encoded(byte)? {
                        return Ok(Some(token));
                    }
                }
                _ => return Err(format!("found the byte {byte:#04x}, which starts no token")),
            }
        }
    }

    /// The bytes of a token, from the one just read to the first that does not belong to it.
    fn run(&mut self, belongs: impl Fn(u8) -> bool) -> String {
        let start = self.at - 1;
        while self.bytes.get(self.at).is_some_and(|&b| belongs(b)) {
            self.at += 1;
        }
        String::from_utf8_lossy(&self.bytes[start..self.at]).into_owned()
    }

    fn number(&mut self) -> Lexed<Token> {
        let word = self.run(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'e' | b'E'));
        word.parse().map(Token::Number).map_err(|_| format!("found {word:?}, expected a number"))
    }

    /// A string up to its closing quote.
    fn quoted(&mut self, quote: u8) -> Lexed<String> {
        let mut text = Vec::new();
        loop {
            match self.byte().map_err(|_| "a string is not terminated".to_owned())? {
                byte if byte == quote => return Ok(String::from_utf8_lossy(&text).into_owned()),
                b'\\' => match self.byte()? {
                    b'n' => text.push(b'\n'),
                    b't' => text.push(b'\t'),
                    b'r' => text.push(b'\r'),
                    b'b' => text.push(8),
                    b'f' => text.push(12),
                    b'\n' => self.line += 1,
                    digit @ b'0'..=b'7' => {
                        let mut code = u32::from(digit - b'0');
                        for _ in 0..2 {
                            let Some(&next @ b'0'..=b'7') = self.bytes.get(self.at) else { break };
                            code = 8 * code + u32::from(next - b'0');
                            self.at += 1;
                        }
                        text.push(code as u8);
                    }
                    other => text.push(other),
                },
                byte => {
                    self.line += usize::from(byte == b'\n');
                    text.push(byte);
                }
            }
        }
    }

    /// A token of the binary encoding; `None` for a definition.
    fn encoded(&mut self, byte: u8) -> Lexed<Option<Token>> {
        Ok(Some(match byte {
            0o200..=0o217 => {
                let (fraction, width) = (byte >> 2 & 3, (byte & 3) + 1);
                let integer = self.integer(width)?;
                // Extend the sign of the highest byte.
                let shift = 64 - 8 * u32::from(width);
                let signed = (integer << shift) as i64 >> shift;
                Token::Number((signed as f64 / 256f64.powi(fraction.into())) as f32)
            }
            0o220..=0o243 => Token::Text(self.encoded_string(byte)?),
            0o244 => Token::Number(f32::from_be_bytes(self.take()?)),
            0o245 => Token::Number(f64::from_be_bytes(self.take()?) as f32),
            0o246 => {
                let code = self.byte()?;
                let name = self.requests.get(&code).ok_or_else(|| format!("request code {code} is not defined"))?;
                Token::Request(name.clone())
            }
            0o310..=0o313 => {
                let count = self.integer(byte - 0o310 + 1)? as usize;
                if count > (self.bytes.len() - self.at) / 4 {
                    return Err(format!("an array of {count} numbers is longer than the rest of the file"));
                }
                self.array = Some(count);
                Token::Open
            }
            0o314 => {
                let code = self.byte()?;
                let name = self.string()?;
                self.requests.insert(code, name);
                return Ok(None);
            }
            0o315 | 0o316 => {
                let code = self.integer(byte - 0o315 + 1)? as u16;
                let text = self.string()?;
                self.strings.insert(code, text);
                return Ok(None);
            }
            0o317 | 0o320 => {
                let code = self.integer(byte - 0o317 + 1)? as u16;
                Token::Text(
                    self.strings.get(&code).ok_or_else(|| format!("string code {code} is not defined"))?.clone(),
                )
            }
            _ => return Err(format!("found the byte {byte:#04x}, which the binary encoding does not define")),
        }))
    }

    /// A string in either encoding.
    fn string(&mut self) -> Lexed<String> {
        match self.byte()? {
            quote @ (b'"' | b'\'') => self.quoted(quote),
            byte @ 0o220..=0o243 => self.encoded_string(byte),
            byte => Err(format!("found the byte {byte:#04x}, expected a string")),
        }
    }

    fn encoded_string(&mut self, byte: u8) -> Lexed<String> {
        let length = if byte < 0o240 { u64::from(byte - 0o220) } else { self.integer(byte - 0o240 + 1)? };
        let end = self.at.checked_add(length as usize).filter(|&end| end <= self.bytes.len()).ok_or(ENDS)?;
        let text = String::from_utf8_lossy(&self.bytes[self.at..end]).into_owned();
        self.at = end;
        Ok(text)
    }

    fn byte(&mut self) -> Lexed<u8> {
        self.take::<1>().map(|[byte]| byte)
    }

    /// A big-endian unsigned number.
    fn integer(&mut self, width: u8) -> Lexed<u64> {
        (0..width).try_fold(0, |sum, _| Ok(sum << 8 | u64::from(self.byte()?)))
    }

    fn take<const N: usize>(&mut self) -> Lexed<[u8; N]> {
        let bytes = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()).ok_or(ENDS)?;
        self.at += N;
        Ok(*bytes)
    }
}

const ENDS: &str = "the file ends within a token";

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> Lexed<Vec<Token>> {
        let mut lexer = Lexer::new(bytes.to_vec());
        std::iter::from_fn(|| lexer.next().transpose()).collect()
    }

    fn text(text: &str) -> Token {
        Token::Text(text.into())
    }

    fn request(name: &str) -> Token {
        Token::Request(name.into())
    }

    #[test]
    fn text_is_split_into_tokens() {
        let found = all(b"##RenderMan\nSphere 1 -.5e1[+2.25 3]\"a\\\"b\\101\\n\" # end\n").unwrap();
        let expected = [
            request("Sphere"),
            Token::Number(1.0),
            Token::Number(-5.0),
            Token::Open,
            Token::Number(2.25),
            Token::Number(3.0),
            Token::Close,
            text("a\"bA\n"),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn binary_tokens_are_decoded() {
        let mut bytes = vec![0o314, 7, 0o226];
        bytes.extend(b"Sphere");
        bytes.extend([0o315, 3, b'"', b'f', b'o', b'v', b'"', 0o246, 7]);
        // -2; 1.5 in two bytes, one of them fractional; 258; -1 in three bytes
        bytes.extend([0o200, 0xfe, 0o205, 1, 0x80, 0o201, 1, 2, 0o202, 0xff, 0xff, 0xff]);
        bytes.push(0o244);
        bytes.extend(0.1f32.to_be_bytes());
        bytes.push(0o245);
        bytes.extend(0.25f64.to_be_bytes());
        bytes.extend([0o310, 2]);
        bytes.extend(3f32.to_be_bytes());
        bytes.extend(4f32.to_be_bytes());
        bytes.extend([0o317, 3, 0o240, 2, b'h', b'i', 0o377, b'!']);
        let numbers = [-2.0, 1.5, 258.0, -1.0, 0.1, 0.25].map(Token::Number);
        let mut expected = vec![request("Sphere")];
        expected.extend(numbers);
        expected.extend([Token::Open, Token::Number(3.0), Token::Number(4.0), Token::Close, text("fov"), text("hi")]);
        assert_eq!(all(&bytes).unwrap(), expected);
    }

    #[test]
    fn truncated_and_undefined_tokens_are_errors() {
        let cases: [&[u8]; 9] = [
            b"\"open",
            b"1.2.3",
            b"*",
            &[0o246, 1],
            &[0o317, 1],
            &[0o310, 200, 0, 0],
            &[0o203, 1],
            &[0o250],
            &[0o225, b'a'],
        ];
        for bytes in cases {
            assert!(all(bytes).is_err(), "{bytes:?}");
        }
    }

    #[test]
    fn lines_within_strings_and_comments_are_counted() {
        let mut lexer = Lexer::new(b"# one\n\"two\nthree\" Four".to_vec());
        lexer.next().unwrap();
        assert_eq!((lexer.next().unwrap(), lexer.line()), (Some(request("Four")), 3));
    }
}
