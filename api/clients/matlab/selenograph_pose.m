function pose = selenograph_pose(position, way, value)
% SELENOGRAPH_POSE  Where a camera is and how it is turned, for requests.
%   position: [x y z] in metres, MOON_ME; or struct('lat_deg', a, 'lon_deg', b, 'height_m', h)
%   way and value:
%     'nadir', up_azimuth_deg              boresight to the Moon's centre; azimuth of the image's up direction
%     'look_at', place                     boresight through struct('lat_deg', a, 'lon_deg', b, 'height_m', h, 'up', u);
%                                          the last two may be left out; up is 'north' or [x y z] in MOON_ME
%     'camera_from_moon_wxyz', q           quaternion that rotates MOON_ME vectors into camera axes, scalar first
%     'camera_from_moon_xyzw', q           the same, scalar last
%     'moon_from_camera_wxyz', q           its inverse, scalar first
%     'moon_from_camera_xyzw', q           its inverse, scalar last
%     'camera_from_moon_matrix', M         v_camera = M * v_moon; the rows are the camera's axes in MOON_ME
%     'moon_from_camera_matrix', M         its inverse
%     'camera_from_moon_mrp', sigma        modified Rodrigues parameters sigma_BN with B the camera and N MOON_ME
%   Camera axes are OpenCV's: +x right, +y down, +z boresight.
  if isstruct(position)
    pose = struct('geodetic', position);
  elseif isnumeric(position) && numel(position) == 3
    pose = struct('position_m', reshape(position, 1, 3));
  else
    error('selenograph:argument', 'position must be [x y z] or a struct of lat_deg, lon_deg and height_m');
  end
  switch way
    case 'nadir', pose.nadir = struct('up_azimuth_deg', value);
    case 'look_at', pose.look_at = value;
    case 'camera_from_moon_wxyz', pose.camera_from_moon = keys(value([1 2 3 4]));
    case 'camera_from_moon_xyzw', pose.camera_from_moon = keys(value([4 1 2 3]));
    case 'moon_from_camera_wxyz', pose.moon_from_camera = keys(value([1 2 3 4]));
    case 'moon_from_camera_xyzw', pose.moon_from_camera = keys(value([4 1 2 3]));
    case 'camera_from_moon_matrix', pose.camera_from_moon = keys(quaternion(value));
    case 'moon_from_camera_matrix', pose.moon_from_camera = keys(quaternion(value));
    case 'camera_from_moon_mrp', pose.camera_from_moon = keys(quaternion(selenograph_mrp_matrix(value)));
    otherwise, error('selenograph:argument', 'unknown way to give an attitude: %s', way);
  end
end

function q = keys(wxyz)
  q = struct('w', wxyz(1), 'x', wxyz(2), 'y', wxyz(3), 'z', wxyz(4));
end

% Scalar first; rotates vectors as the matrix does. (Shepperd 1978: the largest component first.)
function q = quaternion(M)
  if ~isequal(size(M), [3 3]) || norm(M * M' - eye(3)) > 1e-6 || det(M) < 0
    error('selenograph:argument', 'not a rotation matrix');
  end
  t = trace(M);
  [largest, which_one] = max([t, M(1, 1), M(2, 2), M(3, 3)]);
  if which_one == 1
    r = sqrt(1 + t);
    q = [r / 2, [M(3, 2) - M(2, 3), M(1, 3) - M(3, 1), M(2, 1) - M(1, 2)] / (2 * r)];
  else
    i = which_one - 1;
    j = mod(i, 3) + 1;
    k = mod(j, 3) + 1;
    r = sqrt(1 + 2 * largest - t);
    q = zeros(1, 4);
    q(1) = (M(k, j) - M(j, k)) / (2 * r);
    q(1 + i) = r / 2;
    q(1 + j) = (M(i, j) + M(j, i)) / (2 * r);
    q(1 + k) = (M(i, k) + M(k, i)) / (2 * r);
  end
end
