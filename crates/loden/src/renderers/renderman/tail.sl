
/* The space in which loden maps textures: that of the camera, with z towards the viewer. */
point loden_seen(point p) {
    point q = transform("camera", p);
    return point (xcomp(q), ycomp(q), -zcomp(q));
}

vector loden_seen_vector(vector w) {
    vector q = vtransform("camera", w);
    return vector (xcomp(q), ycomp(q), -zcomp(q));
}

vector loden_from_seen(vector w) {
    return vtransform("camera", "current", vector (xcomp(w), ycomp(w), -zcomp(w)));
}

/* The angle around an axis of length 1. */
float loden_turn(vector from_axis, around) {
    float side = ((zcomp(around) < 0) ? -1 : 1);
    float a = -1 / (side + zcomp(around));
    float b = xcomp(around) * ycomp(around) * a;
    vector first = vector (1 + side * xcomp(around) * xcomp(around) * a, side * b, -side * xcomp(around));
    vector second = vector (b, side + ycomp(around) * ycomp(around) * a, -ycomp(around));
    float angle = atan(from_axis . second, from_axis . first);
    return ((angle < 0) ? angle + 2 * PI : angle);
}

surface {SHADER}(
    /* for loden, which reads this file instead of the shader */
    uniform string material = "";
    uniform string numbers = "{NUMBERS}";
    uniform string indices = "{INDICES}";
    uniform string directions = "{DIRECTIONS}";
    /* repeats of the material per unit of texture coordinates, and its rotation in degrees, counter-clockwise */
    uniform float scale = 1;
    uniform float rotation = 0;
    /* shown are angles between view and normal from the least to below the most, in degrees */
    uniform float least = 0;
    uniform float most = 91;
    /* surface, sphere, cylinder, plane or camera; what each of them uses */
    uniform string mapping = "surface";
    uniform point centre = point "shader" (0, 0, 0);
    uniform vector axis = vector "shader" (0, 0, 1);
    uniform point origin = point "shader" (0, 0, 0);
    uniform vector edgeu = vector "shader" (1, 0, 0);
    uniform vector edgev = vector "shader" (0, 1, 0);
    uniform point from = point "shader" (0, 0, 0);
    uniform point to = point "shader" (0, 0, 1);
    uniform vector up = vector "shader" (0, 1, 0);
    uniform float fov = 90)
{
    normal facing = faceforward(normalize(N), I);
    vector viewer = -normalize(I);
    /* near a silhouette, interpolated normals may face away */
    float cosine = facing . viewer;
    if (cosine < 0.001) {
        facing = normalize(facing + viewer * (0.001 - cosine));
    }

    /* Texture coordinates, where u grows along the surface while v stays, and where v grows; t points down */
    float place_u = s;
    float place_v = 1 - t;
    float side = ((Du(s) * Dv(t) - Dv(s) * Du(t) < 0) ? -1 : 1);
    vector grows_u = side * (dPdu * Dv(t) - dPdv * Du(t));
    vector grows_v = side * (dPdu * Dv(s) - dPdv * Du(s));
    if (length(grows_u) == 0) {
        grows_u = dPdu;
        grows_v = -dPdv;
    }
    if (mapping != "surface") {
        point here = loden_seen(P);
        vector gradient_u = vector (1, 0, 0);
        vector gradient_v = vector (0, 1, 0);
        if (mapping == "sphere" || mapping == "cylinder") {
            vector reach = here - loden_seen(centre);
            vector long_axis = loden_seen_vector(axis);
            vector short_axis = normalize(long_axis);
            place_u = loden_turn(reach, short_axis) / PI;
            gradient_u = short_axis ^ reach;
            if (mapping == "sphere") {
                vector outwards = normalize(reach);
                place_v = 1 - acos(clamp(outwards . short_axis, -1, 1)) / PI;
                gradient_v = short_axis - outwards * (outwards . short_axis);
            } else {
                place_v = (reach . long_axis) / (long_axis . long_axis);
                gradient_v = long_axis;
            }
        }
        if (mapping == "plane") {
            vector reach = here - loden_seen(origin);
            gradient_u = loden_seen_vector(edgeu);
            gradient_v = loden_seen_vector(edgev);
            gradient_u = gradient_u / (gradient_u . gradient_u);
            gradient_v = gradient_v / (gradient_v . gradient_v);
            place_u = reach . gradient_u;
            place_v = reach . gradient_v;
        }
        if (mapping == "camera") {
            vector reach = here - loden_seen(from);
            vector forward = normalize(loden_seen(to) - loden_seen(from));
            vector rightwards = normalize(forward ^ loden_seen_vector(up));
            vector upwards = rightwards ^ forward;
            float far = reach . forward;
            float wide = 2 * tan(radians(0.5 * fov)) * far;
            place_u = ((far > 0) ? 0.5 + (reach . rightwards) / wide : -1);
            place_v = ((far > 0) ? 0.5 + (reach . upwards) / wide : -1);
            gradient_u = rightwards / wide - forward * ((reach . rightwards) / (wide * far));
            gradient_v = upwards / wide - forward * ((reach . upwards) / (wide * far));
        }
        vector level = gradient_v ^ loden_seen_vector(facing);
        grows_u = loden_from_seen((((level . gradient_u) < 0) ? -level : level));
        grows_v = loden_from_seen(gradient_v);
    }

    /* The frame of the material, turned by the rotation */
    float cos_turn = cos(radians(rotation));
    float sin_turn = sin(radians(rotation));
    vector along = normalize(grows_u - facing * (facing . grows_u));
    vector across = facing ^ along;
    if ((across . grows_v) < 0) {
        across = -across;
    }
    vector tangent = along * cos_turn + across * sin_turn;
    vector bitangent = across * cos_turn - along * sin_turn;
    vector place = scale * vector (cos_turn * place_u + sin_turn * place_v, cos_turn * place_v - sin_turn * place_u, 0);
    vector wo = normalize(vector (viewer . tangent, viewer . bitangent, max(viewer . facing, 0.0005)));

    /* Add up the lights; one of intensity 1 gives the irradiance pi */
    color reflected = color (0, 0, 0);
    float angle = degrees(acos(min(zcomp(wo), 1)));
    if (angle >= least && angle < most) {
        illuminance(P, facing, PI / 2) {
            vector to_light = normalize(L);
            vector wi = vector (to_light . tangent, to_light . bitangent, to_light . facing);
            vector value = loden_apparent(numbers, indices, directions, place, wi, wo);
            reflected = reflected + Cl * color (xcomp(value), ycomp(value), zcomp(value));
        }
    }
    Oi = Os;
    Ci = Os * reflected;
}
