// Turns: quaternions (w x y z) as the angles that people say: roll, pitch and yaw about fixed axes x, y, z, in degrees.

const DEGREES = 180 / Math.PI;

export function anglesOf([w, x, y, z]) {
  const roll = Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
  const pitch = Math.asin(Math.min(1, Math.max(-1, 2 * (w * y - z * x))));
  const yaw = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
  return [roll, pitch, yaw].map((angle) => angle * DEGREES);
}

export function quaternionOf([roll, pitch, yaw]) {
  const [a, b, c] = [roll, pitch, yaw].map((angle) => angle / DEGREES / 2);
  const [ca, cb, cc] = [a, b, c].map(Math.cos);
  const [sa, sb, sc] = [a, b, c].map(Math.sin);
  return [ca * cb * cc + sa * sb * sc, sa * cb * cc - ca * sb * sc, ca * sb * cc + sa * cb * sc, ca * cb * sc - sa * sb * cc];
}
