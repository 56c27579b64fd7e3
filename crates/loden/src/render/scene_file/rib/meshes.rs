//! Triangle meshes from RIB shapes.

use glam::{Vec2, Vec3, Vec4};

use super::request::{Argument, Class, Parameters, Request, RibResult};
use crate::render::MeshData;
use crate::render::geometry::{self, Basis, ControlMesh, Crease, NurbsAxis, Patch, Quadric};

/// Subdivision steps of a subdivision mesh.
const LEVELS: u32 = 4;

/// Texture coordinates at the corners (0, 0), (1, 0), (0, 1), (1, 1) of a surface's parameters; t points down.
pub(super) type Corners = [Vec2; 4];

pub(super) const CORNERS: Corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];

/// The quadric of a request, if it is one, and the index of its first parameter.
pub(super) fn quadric(request: &Request) -> RibResult<Option<(Quadric, usize)>> {
    let count = match request.name.as_str() {
        "Disk" | "Cone" => 3,
        "Sphere" | "Cylinder" | "Paraboloid" => 4,
        "Torus" => 5,
        "Hyperboloid" => 7,
        _ => return Ok(None),
    };
    let (n, rest) = request.numbers(count)?;
    let quadric = match request.name.as_str() {
        "Sphere" => Quadric::Sphere { radius: n[0], z_min: n[1], z_max: n[2], sweep: n[3] },
        "Cone" => Quadric::Cone { height: n[0], radius: n[1], sweep: n[2] },
        "Cylinder" => Quadric::Cylinder { radius: n[0], z_min: n[1], z_max: n[2], sweep: n[3] },
        "Paraboloid" => Quadric::Paraboloid { r_max: n[0], z_min: n[1], z_max: n[2], sweep: n[3] },
        "Disk" => Quadric::Disk { height: n[0], radius: n[1], sweep: n[2] },
        "Torus" => Quadric::Torus { major_radius: n[0], minor_radius: n[1], phi_min: n[2], phi_max: n[3], sweep: n[4] },
        _ => Quadric::Hyperboloid { from: Vec3::from_slice(&n[..3]), to: Vec3::from_slice(&n[3..]), sweep: n[6] },
    };
    Ok(Some((quadric, request.arguments.len() - rest.len())))
}

/// Replaces surface parameters by texture coordinates, interpolated from the corners.
pub(super) fn map_texture(data: &mut MeshData, corners: &Corners) {
    for uv in &mut data.uvs {
        let [low, high] = [corners[0].lerp(corners[1], uv.x), corners[2].lerp(corners[3], uv.x)];
        *uv = down(low.lerp(high, uv.y));
    }
    if *corners == CORNERS {
        data.tangents.iter_mut().for_each(|t| t.w = -t.w);
    } else {
        // The tangents no longer follow u.
        data.tangents.clear();
    }
}

/// Texture coordinates with v upwards from those with t downwards.
pub(super) fn down(st: Vec2) -> Vec2 {
    Vec2::new(st.x, 1.0 - st.y)
}

/// The loops of each polygon: an outline and holes, as vertex indices.
pub(super) type Loops = Vec<Vec<Vec<u32>>>;

/// The polygons of a request; `None` if it is another request.
pub(super) fn loops(request: &Request, corners: usize) -> RibResult<Option<Loops>> {
    let cut = |counts: &[u32], mut from: &[u32]| -> RibResult<Vec<Vec<u32>>> {
        let mut parts = Vec::with_capacity(counts.len());
        for &count in counts {
            let (part, rest) =
                from.split_at_checked(count as usize).ok_or("found fewer vertex indices than the counts add up to")?;
            parts.push(part.to_vec());
            from = rest;
        }
        if from.is_empty() {
            Ok(parts)
        } else {
            Err(format!("found {} more vertex indices than the counts add up to", from.len()))
        }
    };
    let all: Vec<u32> = (0..corners as u32).collect();
    Ok(Some(match request.name.as_str() {
        "Polygon" => vec![vec![all]],
        "GeneralPolygon" => vec![cut(&request.integers(0)?, &all)?],
        "PointsPolygons" => {
            cut(&request.integers(0)?, &request.integers(1)?)?.into_iter().map(|outline| vec![outline]).collect()
        }
        "PointsGeneralPolygons" => {
            let mut loops = cut(&request.integers(1)?, &request.integers(2)?)?.into_iter();
            let counts = request.integers(0)?;
            let polygons: Loops = counts.iter().map(|&n| loops.by_ref().take(n as usize).collect()).collect();
            if loops.next().is_some() || polygons.iter().zip(&counts).any(|(p, &n)| p.len() != n as usize) {
                return Err("the loop counts of the polygons do not add up to the number of loops".into());
            }
            polygons
        }
        _ => return Ok(None),
    }))
}

/// The index of the first parameter of a polygon request; `None` for other requests.
pub(super) fn polygon_parameters_start(name: &str) -> Option<usize> {
    Some(match name {
        "Polygon" => 0,
        "GeneralPolygon" => 1,
        "PointsPolygons" => 2,
        "PointsGeneralPolygons" => 3,
        _ => return None,
    })
}

/// Triangulates polygons; without normals they are flat.
pub(super) fn polygons(loops: &Loops, parameters: &Parameters) -> RibResult<MeshData> {
    let points = parameters.points()?;
    let cut = geometry::polygons(&points, loops).map_err(|e| e.to_string())?;
    let corners: Vec<u32> = loops.iter().flatten().flatten().copied().collect();
    // Duplicate vertices per corner
    let mut data = MeshData { positions: corners.iter().map(|&i| points[i as usize]).collect(), ..MeshData::default() };
    data.uvs = match parameters.texture() {
        Some((st, class)) => of_corners(&st, class, loops, "texture coordinates")?,
        None => object_coordinates(&data.positions, loops),
    };
    data.uvs.iter_mut().for_each(|st| *st = down(*st));
    if let Some((normals, class)) = parameters.normals()? {
        data.normals = of_corners(&normals, class, loops, "normals")?;
        data.normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    } else {
        data.normals = vec![Vec3::ZERO; corners.len()];
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| data.positions[i as usize]);
            (b - a).cross(c - a)
        };
        // Give all triangles of a polygon its normal.
        let sizes = loops.iter().map(|polygon| polygon.iter().map(Vec::len).sum::<usize>());
        let of_corner: Vec<usize> = sizes.enumerate().flat_map(|(k, n)| std::iter::repeat_n(k, n)).collect();
        let mut sums = vec![Vec3::ZERO; loops.len()];
        cut.iter().for_each(|t| sums[of_corner[t[0] as usize]] += area(t));
        data.normals.iter_mut().zip(&of_corner).for_each(|(n, &k)| *n = sums[k].normalize_or(Vec3::Z));
    }
    data.triangles = cut;
    Ok(data)
}

/// The texture coordinates of polygons that have none: x and y of the object, or, of a polygon seen edge-on along z, the
/// longer of the two and z.
fn object_coordinates(corners: &[Vec3], loops: &Loops) -> Vec<Vec2> {
    let mut rest = corners;
    let mut all = Vec::with_capacity(corners.len());
    for polygon in loops {
        let (own, others) = rest.split_at(polygon.iter().map(Vec::len).sum());
        rest = others;
        let outline = &own[..polygon.first().map_or(0, Vec::len)];
        let next = outline.iter().cycle().skip(1);
        let normal = outline.iter().zip(next).map(|(a, b)| a.cross(*b)).sum::<Vec3>();
        let is_upright = normal.z.abs() < 1e-3 * normal.length();
        all.extend(own.iter().map(|p| match () {
            () if !is_upright => p.truncate(),
            () if normal.x.abs() > normal.y.abs() => Vec2::new(p.y, p.z),
            () => Vec2::new(p.x, p.z),
        }));
    }
    all
}

/// Expands values per polygon, vertex or corner to values per corner.
pub(super) fn of_corners<T: Copy>(values: &[T], class: Class, loops: &Loops, what: &str) -> RibResult<Vec<T>> {
    let corners: Vec<u32> = loops.iter().flatten().flatten().copied().collect();
    let wrong = || format!("found {} {what} for {} corners", values.len(), corners.len());
    match class {
        Class::FaceVarying if values.len() == corners.len() => Ok(values.to_vec()),
        Class::Varying | Class::Vertex => {
            corners.iter().map(|&i| values.get(i as usize).copied().ok_or_else(wrong)).collect()
        }
        Class::Uniform if values.len() == loops.len() => {
            let of = |(value, polygon): (&T, &Vec<Vec<u32>>)| vec![*value; polygon.iter().map(Vec::len).sum()];
            Ok(values.iter().zip(loops).flat_map(of).collect())
        }
        Class::Constant if values.len() == 1 => Ok(vec![values[0]; corners.len()]),
        // of the right number for another class
        _ if values.len() == corners.len() => Ok(values.to_vec()),
        _ if values.len() > corners.iter().max().map_or(0, |&i| i as usize) => {
            Ok(corners.iter().map(|&i| values[i as usize]).collect())
        }
        _ => Err(wrong()),
    }
}

/// A surface over two parameters.
pub(super) enum Parametric {
    Patches { points: Vec<Vec3>, axes: [Axis; 2], cubic: bool },
    Nurbs { points: Vec<Vec4>, axes: [NurbsAxis; 2] },
}

/// The surface of a `Patch`, `PatchMesh` or `NuPatch`.
pub(super) fn parametric(request: &Request, parameters: &Parameters, bases: &[Basis; 2]) -> RibResult<Parametric> {
    if request.name == "NuPatch" {
        return nurbs(request, parameters);
    }
    let cubic = match request.text(0)? {
        "bicubic" => true,
        "bilinear" => false,
        other => return Err(format!("found {other:?}, expected bicubic or bilinear")),
    };
    let side = if cubic { 4 } else { 2 };
    if request.name == "Patch" {
        let axis = Axis { count: side, step: side, patches: 1, wraps: false };
        let points = points_of_grid(parameters, [side, side])?;
        return Ok(Parametric::Patches { points, axes: [axis, axis], cubic });
    }
    let axis = |at: usize, basis: &Basis| {
        let count = *request.integers(at)?.first().ok_or("expected a number of points")? as usize;
        let wraps = match request.text(at + 1)? {
            "periodic" => true,
            "nonperiodic" => false,
            other => return Err(format!("found {other:?}, expected periodic or nonperiodic")),
        };
        let step = if cubic { basis.step } else { 1 };
        let fits = count >= side && (if wraps { count } else { count - side }).is_multiple_of(step);
        if !fits {
            return Err(format!("{count} points do not make whole patches of {side} points with a step of {step}"));
        }
        Ok(Axis { count, step, patches: if wraps { count / step } else { (count - side) / step + 1 }, wraps })
    };
    let axes = [axis(1, &bases[0])?, axis(3, &bases[1])?];
    let points = points_of_grid(parameters, axes.map(|axis| axis.count))?;
    Ok(Parametric::Patches { points, axes, cubic })
}

fn nurbs(request: &Request, parameters: &Parameters) -> RibResult<Parametric> {
    let number = |at: usize| match request.arguments.get(at) {
        Some(Argument::Number(number)) => Ok(*number),
        Some(Argument::Numbers(list)) if list.len() == 1 => Ok(list[0]),
        found => Err(format!("argument {}: found {found:?}, expected a number", at + 1)),
    };
    let axis = |at: usize| {
        let whole = |at: usize| Ok::<_, String>(*request.integers(at)?.first().ok_or("expected a number")? as usize);
        let knots = match request.arguments.get(at + 2) {
            Some(Argument::Numbers(list)) => list.clone(),
            found => return Err(format!("argument {}: found {found:?}, expected knots", at + 3)),
        };
        Ok(NurbsAxis { count: whole(at)?, order: whole(at + 1)?, knots, range: [number(at + 3)?, number(at + 4)?] })
    };
    let axes = [axis(0)?, axis(5)?];
    let points = match parameters.get("Pw") {
        Some(p) if p.numbers.len().is_multiple_of(4) => p.numbers.chunks_exact(4).map(Vec4::from_slice).collect(),
        Some(p) => return Err(format!("Pw: found {} numbers, expected 4 per point", p.numbers.len())),
        None => {
            let grid = axes.each_ref().map(|axis| axis.count);
            points_of_grid(parameters, grid)?.into_iter().map(|p| p.extend(1.0)).collect()
        }
    };
    Ok(Parametric::Nurbs { points, axes })
}

/// The points of P or Pw, or of heights Pz over the unit square.
fn points_of_grid(parameters: &Parameters, [columns, rows]: [usize; 2]) -> RibResult<Vec<Vec3>> {
    let (Some(heights), None, None) = (parameters.get("Pz"), parameters.get("P"), parameters.get("Pw")) else {
        return parameters.points();
    };
    let expected = columns.checked_mul(rows).ok_or("too many points")?;
    if heights.numbers.len() != expected {
        return Err(format!("Pz: found {} numbers, expected {columns} x {rows}", heights.numbers.len()));
    }
    let along = |k: usize, count: usize| k as f32 / (count - 1).max(1) as f32;
    let point = |(k, &z): (usize, &f32)| Vec3::new(along(k % columns, columns), along(k / columns, rows), z);
    Ok(heights.numbers.iter().enumerate().map(point).collect())
}

impl Parametric {
    /// The number of colours along u and v.
    pub(super) fn colors(&self, class: Class) -> [usize; 2] {
        match (self, class) {
            (Self::Patches { axes, .. }, Class::Vertex) => axes.map(|axis| axis.count),
            (Self::Patches { axes, .. }, Class::Uniform) => axes.map(|axis| axis.patches),
            (Self::Patches { axes, .. }, _) => axes.map(|axis| axis.patches + usize::from(!axis.wraps)),
            (Self::Nurbs { axes, .. }, Class::Vertex) => axes.each_ref().map(|axis| axis.count),
            (Self::Nurbs { axes, .. }, _) => axes.each_ref().map(|axis| 2 + axis.count - axis.order),
        }
    }

    /// The mesh, with texture coordinates interpolated from the corners.
    pub(super) fn tessellate(&self, bases: &[Basis; 2], corners: &Corners) -> RibResult<MeshData> {
        match self {
            Self::Patches { points, axes, cubic } => grid(points, *axes, *cubic, bases, corners),
            Self::Nurbs { points, axes } => {
                let mut data = geometry::nurbs_mesh(points, axes).map_err(|e| e.to_string())?;
                map_texture(&mut data, corners);
                Ok(data)
            }
        }
    }
}

/// The index of the first parameter of a patch request; `None` for other requests.
pub(super) fn patch_parameters_start(name: &str) -> Option<usize> {
    Some(match name {
        "Patch" => 1,
        "PatchMesh" => 5,
        "NuPatch" => 10,
        _ => return None,
    })
}

/// Texture coordinates of the corners of a surface. Of a patch mesh with one for each patch, those at its corners.
pub(super) fn corner_texture(parameters: &Parameters, default: &Corners) -> RibResult<Corners> {
    match parameters.texture() {
        None => Ok(*default),
        Some((st, _)) if st.len() < 4 => Err(format!("found {} texture coordinates, expected 4", st.len())),
        Some((st, _)) => Ok(<Corners>::try_from(&st[..]).unwrap_or(*default)),
    }
}

/// One parameter direction of a patch mesh.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    count: usize,
    step: usize,
    patches: usize,
    wraps: bool,
}

fn grid(points: &[Vec3], [u, v]: [Axis; 2], cubic: bool, bases: &[Basis; 2], corners: &Corners) -> RibResult<MeshData> {
    let expected = u.count.checked_mul(v.count).ok_or("too many points")?;
    if points.len() != expected {
        return Err(format!("found {} points, expected {} x {}", points.len(), u.count, v.count));
    }
    let place = |axis: &Axis, patch: usize, k: usize| {
        let at = patch * axis.step + k;
        if axis.wraps { at % axis.count } else { at }
    };
    let point = |i: usize, j: usize, k: usize, l: usize| points[place(&v, j, l) * u.count + place(&u, i, k)];
    let uvs = |i: usize, j: usize| {
        [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(k, l)| Vec2::new((i + k) as f32 / u.patches as f32, (j + l) as f32 / v.patches as f32))
    };
    let places = (0..v.patches).flat_map(|j| (0..u.patches).map(move |i| (i, j)));
    let mut data = if cubic {
        let patch = |(i, j)| Patch { points: std::array::from_fn(|k| point(i, j, k % 4, k / 4)), uvs: uvs(i, j) };
        geometry::bicubic_mesh(&places.map(patch).collect::<Vec<_>>(), &bases[0], &bases[1])
    } else {
        let patch = |(i, j)| Patch { points: std::array::from_fn(|k| point(i, j, k % 2, k / 2)), uvs: uvs(i, j) };
        geometry::bilinear_mesh(&places.map(patch).collect::<Vec<_>>())
    };
    map_texture(&mut data, corners);
    Ok(data)
}

/// The index of the first parameter of a `SubdivisionMesh`.
pub(super) fn subdivision_parameters_start(request: &Request) -> usize {
    // Tags are optional; they come with three more arrays.
    match request.arguments.get(3) {
        Some(Argument::Texts(_)) => 7,
        Some(Argument::Numbers(list)) if list.is_empty() => 7,
        _ => 3,
    }
}

/// A control mesh.
pub(super) struct Control {
    pub mesh: ControlMesh,
    /// Whether faces at the boundary are drawn.
    interpolate: bool,
    /// Descriptions of the tags that are not supported.
    pub unknown: Vec<String>,
}

impl Control {
    pub(super) fn subdivide(mut self) -> RibResult<MeshData> {
        if !self.interpolate {
            self.mesh.hide_boundary();
        }
        let data = geometry::subdivide(&self.mesh, LEVELS).map_err(|e| e.to_string())?;
        if data.triangles.is_empty() && !self.interpolate {
            return Err(
                "all its faces lie at the boundary, which is drawn with the tag \"interpolateboundary\" alone".into()
            );
        }
        Ok(data)
    }
}

/// The control mesh of a `SubdivisionMesh`.
pub(super) fn control_mesh(request: &Request, parameters: &Parameters) -> RibResult<Control> {
    let mut control = ControlMesh { positions: parameters.points()?, ..ControlMesh::default() };
    let mut vertices = &request.integers(2)?[..];
    for count in request.integers(1)? {
        let (face, rest) =
            vertices.split_at_checked(count as usize).ok_or("found fewer vertex indices than the counts add up to")?;
        control.faces.push(face.to_vec());
        vertices = rest;
    }
    if let Some((st, class)) = parameters.texture() {
        let loops: Loops = control.faces.iter().map(|face| vec![face.clone()]).collect();
        control.uvs = of_corners(&st, class, &loops, "texture coordinates")?.into_iter().map(down).collect();
    }
    let (interpolate, unknown) =
        if subdivision_parameters_start(request) == 7 { tags(request, &mut control)? } else { (false, Vec::new()) };
    Ok(Control { mesh: control, interpolate, unknown })
}

/// Applies the tags of a `SubdivisionMesh`. Returns whether boundaries are interpolated, and the unsupported tags.
fn tags(request: &Request, control: &mut ControlMesh) -> RibResult<(bool, Vec<String>)> {
    let (mut interpolate, mut unknown) = (false, Vec::new());
    let names: Vec<String> = match &request.arguments[3] {
        Argument::Texts(names) => names.clone(),
        _ => Vec::new(),
    };
    let counts = request.integers(4)?;
    let integers = request.integers(5)?;
    let floats = match request.arguments.get(6) {
        Some(Argument::Numbers(list)) => &list[..],
        _ => &[],
    };
    let (mut i, mut f) = (0, 0);
    for (k, name) in names.iter().enumerate() {
        let [ni, nf] = [0, 1].map(|c| counts.get(2 * k + c).map_or(0, |&n| n as usize));
        let wrong = || format!("tag {name:?} has fewer values than its counts say");
        let ints = integers.get(i..i + ni).ok_or_else(wrong)?;
        let reals = floats.get(f..f + nf).ok_or_else(wrong)?;
        (i, f) = (i + ni, f + nf);
        match name.as_str() {
            "interpolateboundary" => interpolate = ints.first() != Some(&0),
            "hole" => control.holes.extend(ints),
            "corner" => control.corners.extend(ints),
            "crease" => control.creases.extend(ints.windows(2).enumerate().map(|(k, edge)| Crease {
                edge: [edge[0], edge[1]],
                sharpness: reals.get(k).or(reals.first()).copied().unwrap_or(f32::INFINITY),
            })),
            other => unknown.push(format!("tag {other:?}")),
        }
    }
    Ok((interpolate, unknown))
}
