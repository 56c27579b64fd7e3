//! Runs programs by a small interpreter of their language and compares them with what recipes mean.

use std::collections::HashMap;
use std::path::Path;

use glam::{Vec2, Vec3};
use half::f16;

use super::lang::{Definition, Expr, Program, Stmt, Type};
use super::{Bank, Language, Shader};
use crate::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use crate::codec::interpret::Interpreter;
use crate::codec::{self, CODECS};
use crate::color::Encoding;
use crate::direction::{DirectionSet, Scheme, from_angles};
use crate::material::Blending;
use crate::material::angles::Angles;
use crate::params::Values;
use crate::progress::Silent;
use crate::random::Stream;

#[derive(Debug, Clone, PartialEq)]
enum Value {
    Bool(bool),
    Int(i64),
    Float(f32),
    Vec(Vec<f32>),
    IVec(Vec<i64>),
}

use Value::{Bool, Float, IVec, Int, Vec as Floats};

struct Machine<'a> {
    program: &'a Program,
    banks: &'a [Bank; 3],
}

/// Whether a block ended, and how.
enum End {
    Through,
    Break,
    Return(Value),
}

type Locals = HashMap<String, Value>;

impl Machine<'_> {
    fn call(&self, name: &str, arguments: Vec<Value>) -> Value {
        let read = |bank: usize| match arguments[0] {
            Int(address) => Floats(self.banks[bank].texel(usize::try_from(address).unwrap()).to_vec()),
            _ => panic!("{name} of {arguments:?}"),
        };
        match name {
            "number" => return read(0),
            "byte" => return read(1),
            "exact" => return read(2),
            _ => {}
        }
        if let Some(kind) = Type::named(name) {
            return made(kind, arguments);
        }
        match self.program.items.iter().find(|item| item.name == name).map(|item| &item.definition) {
            Some(Definition::Function { result, params, body }) => {
                assert_eq!(params.len(), arguments.len(), "{name}");
                let mut locals = Locals::new();
                for ((kind, name), argument) in params.iter().zip(arguments) {
                    assert_eq!(type_of(&argument), *kind, "{name}");
                    locals.insert(name.clone(), argument);
                }
                match self.block(body, &mut locals) {
                    End::Return(value) => {
                        assert_eq!(type_of(&value), *result, "{name}");
                        value
                    }
                    _ => panic!("{name} returns nothing"),
                }
            }
            _ => built_in(name, &arguments),
        }
    }

    fn block(&self, body: &[Stmt], locals: &mut Locals) -> End {
        for stmt in body {
            match stmt {
                Stmt::Let(kind, name, value) => {
                    let value = self.expr(value, locals);
                    assert_eq!(type_of(&value), *kind, "{name}");
                    locals.insert(name.clone(), value);
                }
                Stmt::Set(name, value) => {
                    let value = self.expr(value, locals);
                    assert_eq!(type_of(&value), type_of(&locals[name]), "{name}");
                    locals.insert(name.clone(), value);
                }
                Stmt::Add(name, value) => {
                    let sum = binary("+", &locals[name], &self.expr(value, locals));
                    locals.insert(name.clone(), sum);
                }
                Stmt::Break => return End::Break,
                Stmt::Return(value) => return End::Return(self.expr(value, locals)),
                Stmt::If(condition, yes, no) => {
                    let body = if self.expr(condition, locals) == Bool(true) { yes } else { no };
                    match self.block(body, locals) {
                        End::Through => {}
                        end => return end,
                    }
                }
                Stmt::For(name, first, end, body) => {
                    let (Int(first), Int(end)) = (self.expr(first, locals), self.expr(end, locals)) else {
                        panic!("the loop over {name} has no integers")
                    };
                    for k in first..end {
                        locals.insert(name.clone(), Int(k));
                        match self.block(body, locals) {
                            End::Through => {}
                            End::Break => break,
                            end => return end,
                        }
                    }
                }
            }
        }
        End::Through
    }

    fn expr(&self, expr: &Expr, locals: &Locals) -> Value {
        match expr {
            Expr::Number(number) if number.contains(['.', 'e']) => Float(number.parse().unwrap()),
            Expr::Number(number) => Int(number.parse().unwrap()),
            Expr::Name(name) => locals.get(name).cloned().unwrap_or_else(|| self.constant(name)),
            Expr::Call(name, arguments) => {
                self.call(name, arguments.iter().map(|argument| self.expr(argument, locals)).collect())
            }
            Expr::Member(of, names) => {
                let places = names.chars().map(|c| "xyzw".find(c).unwrap());
                match (self.expr(of, locals), names.len()) {
                    (Floats(of), 1) => Float(of["xyzw".find(names).unwrap()]),
                    (IVec(of), 1) => Int(of["xyzw".find(names).unwrap()]),
                    (Floats(of), _) => Floats(places.map(|k| of[k]).collect()),
                    (other, _) => panic!("{other:?}.{names}"),
                }
            }
            Expr::Index(of, at) => match (self.expr(of, locals), self.expr(at, locals)) {
                (Floats(of), Int(at)) => Float(of[usize::try_from(at).unwrap()]),
                (IVec(of), Int(at)) => Int(of[usize::try_from(at).unwrap()]),
                other => panic!("{other:?}"),
            },
            Expr::Unary("!", of) => Bool(self.expr(of, locals) == Bool(false)),
            Expr::Unary(_, of) => match self.expr(of, locals) {
                Int(x) => Int(-x),
                Float(x) => Float(-x),
                other => panic!("-{other:?}"),
            },
            Expr::Binary(sign, a, b) => binary(sign, &self.expr(a, locals), &self.expr(b, locals)),
            Expr::Choose(condition, yes, no) => {
                let chosen = self.expr(condition, locals) == Bool(true);
                self.expr(if chosen { yes } else { no }, locals)
            }
        }
    }

    fn constant(&self, name: &str) -> Value {
        match self.program.items.iter().find(|item| item.name == name).map(|item| &item.definition) {
            Some(Definition::Constant(_, value)) => self.expr(value, &Locals::new()),
            _ => panic!("unknown name {name}"),
        }
    }
}

fn type_of(value: &Value) -> Type {
    match value {
        Bool(_) => Type::Bool,
        Int(_) => Type::Int,
        Float(_) => Type::Float,
        Floats(of) => Type::Vec(of.len() as u8),
        IVec(of) => Type::IVec(of.len() as u8),
    }
}

fn made(kind: Type, arguments: Vec<Value>) -> Value {
    match (kind, &arguments[..]) {
        (Type::Int, [Float(x)]) => Int(*x as i64),
        (Type::Float, [Int(x)]) => Float(*x as f32),
        (Type::Vec(size), [Float(x)]) => Floats(vec![*x; size.into()]),
        (Type::Vec(size), parts) => {
            let one = |part: &Value| match part {
                Float(x) => vec![*x],
                Floats(of) => of.clone(),
                other => panic!("{other:?} in a vector"),
            };
            let all: Vec<f32> = parts.iter().flat_map(one).collect();
            assert_eq!(all.len(), usize::from(size));
            Floats(all)
        }
        (Type::IVec(_), parts) => {
            IVec(parts.iter().map(|part| if let Int(x) = part { *x } else { panic!("{part:?}") }).collect())
        }
        other => panic!("{other:?}"),
    }
}

fn binary(sign: &str, a: &Value, b: &Value) -> Value {
    let float = |a: f32, b: f32| match sign {
        "+" => a + b,
        "-" => a - b,
        "*" => a * b,
        "/" => a / b,
        _ => panic!("{sign}"),
    };
    match (a, b) {
        (Bool(a), Bool(b)) => Bool(if sign == "&&" { *a && *b } else { *a || *b }),
        (Int(a), Int(b)) => match sign {
            "+" => Int(a + b),
            "-" => Int(a - b),
            "*" => Int(a * b),
            "/" => Int(a / b),
            _ => Bool(compared(sign, a, b)),
        },
        (Float(a), Float(b)) if "+-*/".contains(sign) => Float(float(*a, *b)),
        (Float(a), Float(b)) => Bool(compared(sign, a, b)),
        (Floats(a), Float(b)) => Floats(a.iter().map(|a| float(*a, *b)).collect()),
        (Float(a), Floats(b)) => Floats(b.iter().map(|b| float(*a, *b)).collect()),
        (Floats(a), Floats(b)) if a.len() == b.len() => Floats(a.iter().zip(b).map(|(a, b)| float(*a, *b)).collect()),
        other => panic!("{sign} of {other:?}"),
    }
}

fn compared<T: PartialOrd>(sign: &str, a: &T, b: &T) -> bool {
    match sign {
        "==" => a == b,
        "!=" => a != b,
        "<" => a < b,
        ">" => a > b,
        "<=" => a <= b,
        ">=" => a >= b,
        _ => panic!("{sign}"),
    }
}

fn built_in(name: &str, arguments: &[Value]) -> Value {
    let one = |f: fn(f32) -> f32| match &arguments[0] {
        Float(x) => Float(f(*x)),
        Floats(of) => Floats(of.iter().map(|x| f(*x)).collect()),
        other => panic!("{name} of {other:?}"),
    };
    let two = |f: fn(f32, f32) -> f32| match &arguments[..2] {
        [Float(a), Float(b)] => Float(f(*a, *b)),
        [Floats(a), Floats(b)] => Floats(a.iter().zip(b).map(|(a, b)| f(*a, *b)).collect()),
        [Int(a), Int(b)] => Int(if name == "min" { *a.min(b) } else { *a.max(b) }),
        other => panic!("{name} of {other:?}"),
    };
    match (name, arguments) {
        ("abs", _) => one(f32::abs),
        ("atan", [_]) => one(f32::atan),
        ("exp", _) => one(f32::exp),
        ("floor", _) => one(f32::floor),
        ("sqrt", _) => one(f32::sqrt),
        ("inversesqrt", _) => one(|x| 1.0 / x.sqrt()),
        ("max", _) => two(f32::max),
        ("min", _) => two(f32::min),
        ("pow", _) => two(f32::powf),
        ("mix", [Float(a), Float(b), Float(t)]) => Float(a + t * (b - a)),
        ("clamp", [value, low, high]) => {
            built_in("min", &[built_in("max", &[value.clone(), low.clone()]), high.clone()])
        }
        ("dot", [Floats(a), Floats(b)]) if a.len() == b.len() => Float(a.iter().zip(b).map(|(a, b)| a * b).sum()),
        ("cross", [Floats(a), Floats(b)]) => Floats(Vec3::from_slice(a).cross(Vec3::from_slice(b)).to_array().to_vec()),
        other => panic!("{other:?}"),
    }
}

/// Rounding of single precision, which the steep end of an encoding near black magnifies.
const ROUNDING: f32 = 1e-4;

/// Compares the program of a stored material with what its recipe means, at points and directions of which some are below
/// the surface.
fn same(path: &Path) {
    let material = codec::open(path).unwrap();
    let parts = Interpreter::new(&**material.parts()).unwrap().explicit(&|x| f16::from_f64(x).to_f32());
    let angles = Angles::new(material.meta(), Scheme::Triangles).unwrap();
    let shader = Shader::new(path, &material).unwrap();
    let machine = Machine { program: &shader.material, banks: &shader.banks };
    let mut bright = 0;
    for i in 0..24 {
        let k = i as f32;
        let direction = |k: f32| from_angles(if k % 8.0 == 7.0 { 1.7 } else { (k * 0.377).fract() * 1.55 }, k * 2.4);
        let (uv, wi, wo) = (Vec2::new(k * 0.618, 1.0 - k * 0.414), direction(k), direction(7.0 * k + 3.0));
        let blending = parts.recipe().blending(Blending::Auto);
        let expected = parts.apparent(uv, &angles, blending, wi, wo).unwrap();
        let arguments = vec![Floats(uv.to_array().into()), Floats(wi.to_array().into()), Floats(wo.to_array().into())];
        let Floats(found) = machine.call("apparent", arguments) else { panic!("no colour") };
        let found = Vec3::from_slice(&found);
        let error = (found - expected).abs().max_element();
        assert!(error < ROUNDING * expected.max_element().max(1.0), "{} {i}: {found} {expected}", path.display());
        bright += usize::from(expected.max_element() > 0.01);
    }
    assert!(bright > 8, "{}: only {bright} values are not black", path.display());
}

/// A BTF of 4 x 3 texels with highlights.
fn sample() -> MemoryBtf {
    let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::U8);
    let [views, lights] = [DirectionSet::bonn81(), DirectionSet::bonn81()];
    let meta = BtfMeta { width: 4, height: 3, views, lights, encoding, cosine, sample_type };
    let mut random = Stream::new(5);
    let noise: Vec<f32> = (0..36).map(|_| random.next()).collect();
    let pairs = meta.views.directions().iter().flat_map(|wo| meta.lights.directions().iter().map(move |wi| (wo, wi)));
    let image = |(wo, wi): (&Vec3, &Vec3)| {
        let shine = wi.z * (0.3 + 0.7 * (*wi + *wo).normalize().z.powi(8));
        noise.iter().map(move |v| (20.0 + 220.0 * v * shine) as u8).collect::<Vec<_>>()
    };
    let texels: Vec<u8> = pairs.flat_map(image).collect();
    MemoryBtf::new(meta, Texels::U8(texels.into())).unwrap()
}

#[test]
fn programs_of_all_codecs_give_what_their_recipes_mean() {
    let (folder, source) = (tempfile::tempdir().unwrap(), sample());
    for codec in CODECS.iter().filter(|codec| codec.name() != "neural") {
        let path = folder.path().join(format!("{}.loden", codec.name()));
        let (params, _) = codec::suited(*codec, source.meta(), &Values::defaults(codec.params())).unwrap();
        codec.encode(&source, &params, &path, &Silent).unwrap();
        same(&path);
    }
}

#[test]
fn programs_of_analytic_models_give_what_their_recipes_mean() {
    let (folder, source) = (tempfile::tempdir().unwrap(), sample());
    let codec = codec::by_name("analytic").unwrap();
    for model in super::models::names() {
        let path = folder.path().join(format!("{model}.loden"));
        let params = Values::new(codec.params(), [("model", model)]).unwrap();
        codec.encode(&source, &params, &path, &Silent).unwrap();
        same(&path);
    }
}

#[test]
fn programs_are_printed_in_the_words_of_each_language() {
    let text = "// Doubled.\nfloat twice(float x, int n) {\n    float sum = 0.0;\n    for (int k = 0; k < n; k++) {\n        sum += x > 1.0 ? x : 2.0 * (x + 1.0);\n    }\n    return sum;\n}\n";
    let program = Program::parse(text).unwrap();
    let glsl = program.print(Language::Glsl);
    assert_eq!(Program::parse(&glsl.replace("loden_", "")).unwrap(), program, "{glsl}");
    let wgsl = program.print(Language::Wgsl);
    assert!(
        wgsl.contains("fn loden_twice(x: f32, n: i32) -> f32 {")
            && wgsl.contains("select(2.0 * (x + 1.0), x, x > 1.0)"),
        "{wgsl}"
    );
    let tsl = program.print(Language::Tsl);
    assert!(
        tsl.contains("sum.addAssign(select(x.greaterThan(float(1.0)), x, float(2.0).mul(x.add(float(1.0)))));"),
        "{tsl}"
    );
    for wrong in ["float f() {", "float f() { return 1.0 }", "thing f() { return 1.0; }", "float f() { return #; }"] {
        assert!(Program::parse(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn texels_are_found_again_in_every_layer() {
    let mut bank = Bank::new("numbers", super::bank::Format::Single);
    assert_eq!(bank.push([1.0, 2.0, 3.0, 4.0, 5.0]), 0);
    assert_eq!(bank.push([6.0]), 2);
    assert_eq!((bank.texel(1), bank.texel(2)), ([5.0, 0.0, 0.0, 0.0], [6.0, 0.0, 0.0, 0.0]));
    let [width, height, layers] = bank.size();
    assert!(width * height * layers >= 3 && width.is_power_of_two() && height.is_power_of_two());
    let mut large = Bank::new("numbers", super::bank::Format::Byte);
    large.push(std::iter::repeat_n(7.0, 4 * (2048 * 2048 + 1)));
    assert_eq!(large.size(), [2048, 2048, 2]);
    assert!(large.check(Path::new("x")).is_ok());
    assert_eq!(large.into_bytes().len(), 2 * 2048 * 2048 * 4);
}
