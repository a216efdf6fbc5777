function points = DelaunayTri(varargin)
  % The points alone: LFToolbox asks a triangulation for nothing but nearest neighbours.
  points = [varargin{:}];
end
