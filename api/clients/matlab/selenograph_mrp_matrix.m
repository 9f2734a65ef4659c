function BN = selenograph_mrp_matrix(sigma_BN)
% SELENOGRAPH_MRP_MATRIX  The direction cosine matrix [BN] of modified Rodrigues parameters: v_B = [BN] v_N.
%   As Schaub and Junkins and Basilisk have them. With a camera on the body B, and N MOON_ME:
%   selenograph_pose(position, 'camera_from_moon_matrix', camera_from_body * selenograph_mrp_matrix(sigma_BN))
  s = sigma_BN(:);
  square = s' * s;
  tilde = [0 -s(3) s(2); s(3) 0 -s(1); -s(2) s(1) 0];
  BN = eye(3) + (8 * tilde ^ 2 - 4 * (1 - square) * tilde) / (1 + square) ^ 2;
end
