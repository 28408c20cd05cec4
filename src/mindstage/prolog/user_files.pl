% Loading files of KnowRob users: their libraries and ROS packages.
%
% A library that such a file names is, in this order: one that Mindstage has predicates for (nothing is loaded, they are
% there), one of SWI-Prolog, a file of the user's packages, or missing. A missing library is a warning with the reason; the
% rest of the file is loaded, and a goal that calls one of its predicates throws the error of an unknown procedure.

:- module(mindstage_user_files,
          [ register_ros_package/1, register_ros_package/2, use_ros_module/2, use_directory/1, rospack_package_path/2, ros_package_path/2,
            ros_package_iri/2, interface/2, begin_rdf_tests/2, begin_rdf_tests/3, end_rdf_tests/1,
            log_message/2, log_error/1, log_warning/1, log_info/1, log_debug/1 ]).
:- use_module(questions).
:- use_module(library(apply)).
:- use_module(library(debug)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(option)).
:- use_module(library(prolog_wrap)).
:- use_module(knowrob_language, [knowrob_not_here/2]).
:- use_module(library(semweb/rdf_prefixes), []).

:- dynamic package_folder/2, warned_package/1, warned_prefix/1, interface_exports/3.
% missing_library(Scope, Module, Name-Reason, Imports): Imports is all, or the list of a use_module/2. missing_object(Source):
% a library of machine code. missing_package(Scope, Module, Package). Scope is in(Source, Root): see load_scope/1.
:- dynamic missing_library/4, missing_object/1, missing_package/3.
:- dynamic user:file_search_path/2, user:prolog_load_file/2, user:library_directory/1.
:- multifile user:file_search_path/2, user:prolog_load_file/2, user:library_directory/1.

% Operators of libraries that KnowRob's files use without loading them: of rdf_db, and @true of XPCE and JPL. The priority of
% rdf_meta is 1150 in rdf_db, with which [rdf_meta/1] in the imports of KnowRob 2's files is a syntax error; with less than that
% of /, a directive is read as (rdf_meta First), Others, which is restated below.
:- op(399, fx, user:rdf_meta).
:- op(100, fx, user:(@)).
% Rules of KnowRob 2: Head ?> Body is asked, Head +> Body is told, Head ?+> Body is both.
:- op(1150, xfx, user:(?>)).
:- op(1150, xfx, user:(+>)).
:- op(1150, xfx, user:(?+>)).

% -- libraries ---------------------------------------------------------------------------------------------------------

% own_library(?Name): libraries whose predicates are those of Mindstage. Within SWI-Prolog's own libraries none is replaced.
own_library('semweb/rdf_db').
own_library('semweb/rdfs').
own_library('semweb/owl').
own_library('semweb/owl_parser').
own_library('semweb/rdfs_computable').
own_library('semweb/owl_computable').
own_library('semweb/rdf_edit').
own_library('semweb/rdf_portray').
own_library(rdf_db).
own_library(rdfs).
own_library(owl).
own_library(owl_parser).
own_library(rdfs_computable).
own_library(owl_computable).
own_library(knowrob_owl).
own_library(rosprolog).
own_library('knowrob/knowrob').
own_library('knowrob/rdfs').
own_library('knowrob/owl').
own_library('knowrob/owl_parser').
own_library('knowrob/computable').
own_library('thea/owl_parser').
own_library('thea2/owl2_model').

% foreign_library(?Name, -Needs): libraries that need something outside of Prolog.
foreign_library(jpl, "Java (the package swi-prolog-java)").
foreign_library(odbc, "an ODBC database (the package swi-prolog-odbc)").
foreign_library(Name, "a MongoDB server and its Java client") :- contains(Name, mongo).
foreign_library(Name, "Java (its predicates call jpl)") :- contains(Name, jpl), Name \== jpl.
foreign_library(Name, "ROS nodes (tf)") :- member(Part, [tf_prolog, transforms, tf_]), contains(Name, Part).
foreign_library(Name, "ROS nodes") :- member(Part, [roscpp, rosprolog, ros_, 'ros/', 'comm/']), contains(Name, Part).
foreign_library(Name, "the Java canvas or marker publisher of KnowRob") :- member(Part, [mod_vis, marker_vis]), contains(Name, Part).

contains(Name, Part) :- once(sub_atom(Name, _, _, _, Part)).

user:prolog_load_file(Module:Spec, Options) :-
    nonvar(Spec),
    Spec = library(_),
    mindstage_user_files:loads_elsewhere(Module, Spec, Options).

% loads_elsewhere(+Module, +Spec, +Options): handles a library that SWI-Prolog does not have, or that is replaced.
loads_elsewhere(Module, library(Spec), Options) :-
    library_name(Spec, Name),
    prolog_load_context(source, Source),
    \+ of_swi_prolog(Source),
    (   own_library(Name) -> true
    ;   absolute_file_name(library(Name), _, [file_type(prolog), access(read), file_errors(fail)]) -> fail
    ;   package_file(Source, Name, File)
    ->  option(imports(Imports), Options, all),
        Module:use_module(File, Imports)
    ;   of_knowrob(Source, Name),
        imported_names(Options, Imports),
        report_missing(Source, Module, Name, Imports)
    ).

% library_name(+Spec, -Name): without the extension; semweb/rdf_db and 'semweb/rdf_db.pl' are the same library.
library_name(Spec, Name) :-
    path_atom(Spec, Atom),
    ( atom_concat(Name, '.pl', Atom) -> true ; Name = Atom ).

path_atom(Spec, Spec) :- atom(Spec), !.
path_atom(Parent/Child, Atom) :-
    path_atom(Parent, First),
    path_atom(Child, Second),
    atomic_list_concat([First, Second], /, Atom).

of_swi_prolog(Source) :- current_prolog_flag(home, Home), sub_atom(Source, 0, _, _, Home).

% of_knowrob(+Source, +Name): the file is in a ROS package, or the library is one of KnowRob.
of_knowrob(Source, _) :- prolog_folder(Source, _), !.
of_knowrob(Source, _) :- registered_by(Source), !.
of_knowrob(_, Name) :-
    (   foreign_library(Name, _)
    ;   member(Part, [knowrob, comp_, mod_, 'semweb/', thea, srdl, ias_, cram, ros]), contains(Name, Part)
    ;   member(Folder, ['model/', 'lang/', 'db/', 'utility/', 'reasoning/', 'comm/', 'query/']),  % of KnowRob 2
        sub_atom(Name, 0, _, _, Folder)
    ), !.

registered_by(Source) :- package_folder(_, by(Source)).

% Of a library that KnowRob has and Mindstage has predicates for, only those that are not here are missing.
report_missing(_, _, Name, Imports) :-
    covered_library(Name), is_list(Imports),
    forall(member(Indicator, Imports), is_here(Indicator)), !.
report_missing(Source, Module, Name, Imports) :-
    (   covered_library(Name)
    ->  Reason = covered(Absent), absent_imports(Imports, Absent)
    ;   foreign_library(Name, Needs)
    ->  format(string(Reason), "it needs ~w, which Mindstage does not use", [Needs])
    ;   Reason = "no package beside this file contains it, and SWI-Prolog does not have it"
    ),
    (   missing_library(in(Source, _), _, Name-_, _) -> true
    ;   Reason = covered(Without) -> print_message(warning, mindstage_covered_library(Name, Without))
    ;   print_message(warning, mindstage_missing_library(Name, Reason))
    ),
    load_scope(Scope),
    (   missing_library(Scope, Module, Name-Reason, Imports) -> true
    ;   assertz(missing_library(Scope, Module, Name-Reason, Imports))
    ).

is_here(Name/Arity) :-
    functor(Head, Name, Arity),
    predicate_property(mindstage:Head, defined),
    \+ knowrob_not_here(Name/Arity, _).
is_here(op(_, _, _)).

absent_imports(all, all) :- !.
absent_imports(Imports, Absent) :-
    exclude(is_here, Imports, Missing),
    findall(Text, ( member(Indicator, Missing), format(atom(Text), "~q", [Indicator]) ), Absent).

% covered_library(?Name): libraries of KnowRob whose predicates, or most of them, are in docs/reference/prolog.md.
covered_library(Name) :-
    member(Name, [ knowrob_objects, knowrob_actions, knowrob_temporal, knowrob_mem, knowrob_perception, comp_spatial, comp_temporal,
                   semantic_map_utils, comp_semantic_map, ias_semantic_map, ias_prolog_addons, knowrob_common, entities,
                   'knowrob/temporal', 'knowrob/objects', 'knowrob/entities', 'knowrob/computables', 'knowrob/comp_spatial',
                   'knowrob/comp_temporal', 'knowrob/utility', 'knowrob/event_memory', 'knowrob/lang/ask', 'knowrob/lang/tell',
                   'knowrob/model/Object', 'lang/query', 'lang/sentence', 'lang/db', 'lang/computable', 'lang/designator',
                   'model/RDFS', 'model/OWL', 'reasoning/OWL/plowl/class', logging, openease ]), !.
covered_library(Name) :-
    member(Folder, ['lang/terms/', 'lang/scopes/', 'model/DUL/', 'model/SOMA/', 'model/EASE/']),
    sub_atom(Name, 0, _, _, Folder), !.

% load_scope(-Scope): in(Source, Root): the file that is being loaded, and the first of the files that load one another.
load_scope(in(Source, Root)) :-
    ( prolog_load_context(source, Source) -> true ; Source = '' ),
    findall(File, '$load_input'(File, _), Files),
    ( last(Files, Last) -> Root = Last ; Root = Source ).

% imported_names(+Options, -Imports): Name/Arity of the list of a use_module/2, or all.
imported_names(Options, Imports) :-
    (   option(imports(Names), Options), is_list(Names)
    ->  findall(Name/Arity, member(Name/Arity, Names), Imports)
    ;   Imports = all
    ).

% -- ROS packages ------------------------------------------------------------------------------------------------------

% prolog_folder(+File, -Folder): the folder prolog/ of the package that a file is in, or src/, as in KnowRob 2.
prolog_folder(File, Folder) :-
    file_directory_name(File, Directory),
    (   is_prolog_folder(Directory)
    ->  Folder = Directory
    ;   Directory \== File,
        file_directory_name(Directory, Above),
        Above \== Directory,
        prolog_folder(Directory, Folder)
    ).

is_prolog_folder(Directory) :- file_base_name(Directory, prolog), !.
is_prolog_folder(Directory) :-
    file_base_name(Directory, src),
    (   directory_file_path(Directory, '__init__.pl', Init), exists_file(Init)
    ;   file_directory_name(Directory, Package), directory_file_path(Package, 'package.xml', Manifest), exists_file(Manifest)
    ), !.

% package_file(+Source, +Library, -File): in a registered package, in that of the source, or in one beside it.
package_file(Source, Name, File) :-
    atom_concat(Name, '.pl', Base),
    candidate_folder(Source, Folder),
    directory_file_path(Folder, Base, File),
    exists_file(File), !.

candidate_folder(_, Folder) :- package_folder(Folder, registered).
candidate_folder(Source, Folder) :- file_directory_name(Source, Folder).
candidate_folder(Source, Folder) :-
    prolog_folder(Source, Own),
    (   Folder = Own
    ;   file_directory_name(Own, Package),
        file_directory_name(Package, Stack),
        member(Base, [prolog, src]),
        request(neighbor_folders(Stack, Base), Folders),  % not expand_file_name/2: names that are not UTF-8 abort it
        member(Folder, Folders),
        is_prolog_folder(Folder)
    ).

%!  register_ros_package(+Package) is det.
%
%   Adds the folder prolog/ of a ROS package to the libraries, and loads its init.pl. The package is searched beside the file
%   that is being loaded and among the packages of the knowledge base. One that is not found is a warning.
register_ros_package(Package) :- register_ros_package(Package, _).

register_ros_package(Package, Folder) :-
    must_be(atom, Package),
    ( prolog_load_context(source, Source) -> true ; Source = '' ),
    (   ros_package_folder(Source, Package, Path)
    ->  directory_file_path(Path, prolog, Found),
        atom_concat(Found, /, Folder),
        register_folder(Source, Package, Found)
    ;   Folder = '',
        report_missing_package(Source, Package)
    ).

rospack_package_path(Package, Path) :-
    ( prolog_load_context(source, Source) -> true ; Source = '' ),
    ros_package_folder(Source, Package, Path).

use_ros_module(Package, File) :-
    register_ros_package(Package, Folder),
    atom_concat(Folder, File, Path),
    user:use_module(Path).

ros_package_path(Package, Path) :- rospack_package_path(Package, Path).

% use_directory(+Folder): of KnowRob 2: loads __init__.pl of a folder beside the file that is being loaded.
use_directory(Folder) :-
    must_be(atom, Folder),
    prolog_load_context(directory, Directory),
    atomic_list_concat([Directory, Folder, '__init__.pl'], /, File),
    prolog_load_context(module, Module),
    (   exists_file(File)
    ->  Module:load_files(File, [if(not_loaded)])
    ;   print_message(warning, mindstage_missing_directory(File)),
        load_scope(Scope),
        assertz(missing_package(Scope, Module, Folder))
    ).

% ros_package_iri(+Package, +Iri): of KnowRob 2. Ontologies are found by the folders of packages, so that nothing is to be done.
ros_package_iri(Package, Iri) :- must_be(atom, Package), must_be(atom, Iri).

ros_package_folder(Source, Package, Path) :-
    candidate_folder(Source, Folder),
    file_directory_name(Folder, Path),
    file_base_name(Path, Package), !.
ros_package_folder(_, Package, Path) :-
    request(ros_package_folder(Package), Found),
    Found \== none,
    Path = Found.

register_folder(_, _, Folder) :- package_folder(Folder, registered), !.
register_folder(Source, _, Folder) :-
    assertz(package_folder(Folder, registered)),
    assertz(package_folder(Folder, by(Source))),
    assertz(user:file_search_path(ros, Folder)),
    member(Name, ['init.pl', '__init__.pl']),
    directory_file_path(Folder, Name, Init),
    exists_file(Init), !,
    (   \+ same_file(Init, Source) -> user:load_files(Init, [if(not_loaded)]) ; true ).
register_folder(_, _, _).

report_missing_package(Source, Package) :-
    assertz(package_folder(Package, by(Source))),
    ( prolog_load_context(module, Module) -> true ; Module = user ),
    load_scope(Scope),
    assertz(missing_package(Scope, Module, Package)),
    (   warned_package(Package) -> true
    ;   assertz(warned_package(Package)),
        print_message(warning, mindstage_missing_package(Package))
    ).

% -- errors while a file is loaded ------------------------------------------------------------------------------------

% A directive that calls a predicate which a missing library may provide is a warning with the reason, since the rest of the
% file is loaded. The same holds for exports that no clause defines: SWI-Prolog loads such a module too.
:- multifile user:message_hook/3.
:- dynamic user:message_hook/3.

user:message_hook(Message, error, _) :-
    mindstage_user_files:outside_warning(Message, Warning),
    print_message(warning, Warning).

outside_warning(undefined_export(Module, Procedure), mindstage_missing_predicate(Procedure, Reason)) :- !,
    (   module_property(Module, file(File)),
        missing_object(File)
    ->  Reason = "it is one of a library of machine code that is not loaded"
    ;   Reason = "its module exports it without a clause"
    ).
outside_warning(Message, Warning) :-
    load_error(Message, Source, Error),
    outside_reason(Error, Source, Warning).

load_error(initialization_error(_, Error, Source:_), Source, Error) :- !.
load_error(Error, Source, Error) :- prolog_load_context(source, Source).

% outside_reason(+Error, +Source, -Warning): the error is about something outside of Prolog.
outside_reason(error(existence_error(procedure, Procedure), _), Source, mindstage_missing_predicate(Procedure, Reason)) :-
    strip_module(Procedure, Module, Name/Arity),
    missing_predicate(Source, Module, Name/Arity, Reason).
outside_reason(error(shared_object(_, Message), _), Source, mindstage_missing_object(Message)) :-
    \+ of_swi_prolog(Source),
    ( missing_object(Source) -> true ; assertz(missing_object(Source)) ).

% missing_predicate(+Source, +Module, +Indicator, -Reason): the predicate may be one of what could not be loaded.
missing_predicate(_, _, Name/_, Reason) :-
    atom_concat(jpl_, _, Name), !,
    foreign_library(jpl, Needs),
    format(string(Reason), "it needs ~w, which Mindstage does not use", [Needs]).
missing_predicate(Source, Module, Name/Arity, Reason) :-
    findall(Why, provider(Source, Module, Name/Arity, Why), Found),
    Found \== [],
    \+ is_misspelled(Module, Name/Arity), !,
    list_to_set(Found, Whys),
    atomic_list_concat(Whys, ', ', Text),
    format(string(Reason), "it is taken to be one of ~w, which could not be loaded", [Text]).

% provider(+Source, +Module, +Indicator, -Why): what could not be loaded, and was imported by the file of the directive, or, by
% the files that load one another, into the module of the call or into user, from where all modules inherit.
provider(Source, Module, Indicator, Why) :-
    missing_library(Scope, Into, Name-_, Imports),
    is_visible(Scope, Into, Source, Module),
    exports_name(Name, Imports, Indicator),
    format(atom(Why), "library(~q)", [Name]).
provider(Source, Module, _, Why) :-
    missing_package(Scope, Into, Package),
    is_visible(Scope, Into, Source, Module),
    format(atom(Why), "the package ~q", [Package]).
provider(Source, _, _, 'a library of machine code') :- missing_object(Source).
provider(_, Module, _, 'a library of machine code') :- module_property(Module, file(File)), missing_object(File).

is_visible(in(Source, _), _, Source, _) :- !.
is_visible(in(_, Root), Into, _, Module) :-
    memberchk(Into, [Module, user]),
    load_scope(in(_, Root)).

% exports_name(+Library, +Imports, +Indicator): the import list decides; libraries whose exports have a prefix have no others.
exports_name(jpl, _, Name/_) :- !, atom_concat(jpl_, _, Name).
exports_name(odbc, _, Name/_) :- !, atom_concat(odbc_, _, Name).
exports_name(_, all, _) :- !.
exports_name(_, Imports, Indicator) :- memberchk(Indicator, Imports).

% is_misspelled(+Module, +Indicator): a predicate that can be called there has the same name and another number of arguments, or
% the same number of arguments and nearly the same name, so that the error is one of the file.
is_misspelled(Module, Name/_) :-
    member(Visible, [Module, user, mindstage, system]),
    current_predicate(Visible:Name/_),
    functor_is_defined(Visible, Name), !.
is_misspelled(_, Name/Arity) :-
    functor(Head, Name, Arity),
    '$dwim':dwim_predicate(mindstage:Head, Similar),
    strip_module(Similar, _, Found),
    functor(Found, Other, Arity),
    Other \== Name, !.
is_misspelled(_, Name/Arity) :-
    standard_predicate(Other, Arity),
    Other \== Name,
    dwim_match(Name, Other), !.

% standard_predicate(-Name, +Arity): one of SWI-Prolog's system predicates, or of its libraries that are loaded when needed.
standard_predicate(Name, Arity) :- '$in_library'(Name, Arity, _).
standard_predicate(Name, Arity) :-
    predicate_property(system:Head, built_in),
    functor(Head, Name, Arity),
    \+ sub_atom(Name, 0, _, _, $).

functor_is_defined(Module, Name) :-
    current_predicate(Name, Module:Head),
    ( predicate_property(Module:Head, defined) ; predicate_property(Module:Head, imported_from(_)) ), !.

% -- the syntax of KnowRob 2 ---------------------------------------------------------------------------------------------

% Rules are clauses; what is told by +> and ?+> is listed by told_by/2.
:- multifile user:term_expansion/2, told_by/2.
:- dynamic user:term_expansion/2, told_by/2.

user:term_expansion((Head ?> Body), Clause) :- mindstage_user_files:asked_clause(Head, Body, Clause).
user:term_expansion((Head +> Body), mindstage_user_files:told_by(Told, Goal)) :-
    mindstage_user_files:rule_parts(Head, Body, Told, Goal).
user:term_expansion((Head ?+> Body), [Clause, mindstage_user_files:told_by(Told, Goal)]) :-
    mindstage_user_files:asked_clause(Head, Body, Clause),
    mindstage_user_files:rule_parts(Head, Body, Told, Goal).
user:term_expansion((:- rdf_meta(First), Others), Directives) :-
    (   mindstage_user_files:mode_heads(Others)
    ->  Directives = (:- rdf_meta((First, Others)))
    ;   Directives = [(:- rdf_meta(First)), (:- Others)]
    ).
user:term_expansion((:- module(Name, Exports)), Terms) :-
    is_list(Exports),
    mindstage_user_files:module_terms(Name, Exports, Terms).

asked_clause(Head, Body, (Asked :- Goal)) :- rule_parts(Head, Body, Asked, Goal).

% rule_parts(+Head, +Body, -AskedHead, -Goal): without the options of a head, and the braces of goals that are not translated to
% queries of KnowRob's database, such as a cut.
rule_parts(Head, Body, Asked, Goal) :-
    (   nonvar(Head), Head = (Asked, _Options) -> true ; Asked = Head ),
    rule_goal(Body, Goal).

rule_goal(Body, Body) :- var(Body), !.
rule_goal({Goal}, Goal) :- !.
rule_goal(pragma(Goal), Goal) :- !.
rule_goal(Body, Goal) :-
    compound(Body), functor(Body, Name, 2), memberchk(Name, [',', ;, ->, *->]), !,
    Body =.. [Name, First, Second],
    rule_goal(First, A),
    rule_goal(Second, B),
    Goal =.. [Name, A, B].
rule_goal(Body, Body).

% module_terms(+Name, +Exports, -Terms): exports of KnowRob 2 are also Name(Mode, …), which declare rdf_meta/1, with ->
% Property, which is computed by the predicate, and implements(File), which are the exports of an interface.
module_terms(Name, Exports, [(:- module(Name, Plain))|Terms]) :-
    once(( member(Export, Exports), is_extended_export(Export) )),
    prolog_load_context(source, Source),
    \+ of_swi_prolog(Source),
    phrase(exported(Exports), Parts),
    findall(Public, member(export(Public, _, _), Parts), Plain),
    findall(Term, ( member(Part, Parts), export_term(Name, Part, Term) ), Terms).

is_extended_export(Export) :- nonvar(Export), ( Export = (_ -> _) ; modes(Export) ; Export = implements(_) ), !.

modes(Export) :-
    compound(Export),
    \+ Export = op(_, _, _),
    Export =.. [_|Modes],
    forall(member(Mode, Modes), ( atom(Mode), memberchk(Mode, [r, t, o, @, ?, -, +, :]) )).

% mode_heads(+Heads): the rest of a declaration, and no goal that follows it.
mode_heads((First, Others)) :- !, mode_heads(First), mode_heads(Others).
mode_heads(_:Head) :- !, mode_heads(Head).
mode_heads(Head) :-
    compound(Head),
    Head =.. [_|Modes],
    forall(member(Mode, Modes), ( integer(Mode) ; memberchk(Mode, [r, t, o, @, ?, -, +, :, ^, //]) )).

% exported(+Exports)//: export(Public, meta(Modes) or none, property(Property) or none) of each export.
exported([]) --> [].
exported([Export|Exports]) --> exported_one(Export), exported(Exports).

exported_one(implements(File)) --> !, { interface_of(File, Exports) }, exported(Exports).
exported_one((Export -> Property)) --> !,
    { phrase(exported_one(Export), [export(Public, Meta, _)]) },
    [export(Public, Meta, property(Property))].
exported_one(Export) --> { modes(Export) }, !, { functor(Export, Name, Arity) }, [export(Name/Arity, meta(Export), none)].
exported_one(Export) --> [export(Export, none, none)].

export_term(Module, export(_, meta(Modes), _), (:- rdf_meta(Module:Modes))).
export_term(Module, export(Name/2, _, property(Property)), (mindstage_semweb:computable(Iri, Subject, Value) :- Module:Goal)) :-
    catch(rdf_prefixes:rdf_global_id(Property, Iri), _, fail),
    atom(Iri),
    Goal =.. [Name, Subject, Value].

% interface(+Name, +Exports): of KnowRob 2: a list of exports for modules that implement it.
interface(Name, Exports) :-
    must_be(list, Exports),
    prolog_load_context(source, Source),
    retractall(interface_exports(Source, Name, _)),
    assertz(interface_exports(Source, Name, Exports)).

interface_of(Spec, Exports) :-
    prolog_load_context(source, Source),
    (   Spec = library(Inner), library_name(Inner, Name), package_file(Source, Name, File) -> true
    ;   absolute_file_name(Spec, File, [file_type(prolog), access(read), relative_to(Source), file_errors(fail)])
    ->  true
    ;   atom(Spec), library_name(Spec, Name), package_file(Source, Name, File)
    ), !,
    user:load_files(File, [if(not_loaded)]),
    ( interface_exports(File, _, Exports) -> true ; Exports = [] ).
interface_of(Spec, []) :- print_message(warning, mindstage_missing_interface(Spec)).

% begin_rdf_tests(+Name, +Source, +Options): of KnowRob 2: a unit of tests that reads an ontology first; test is its prefix.
begin_rdf_tests(Name, Source) :- begin_rdf_tests(Name, Source, []).
begin_rdf_tests(Name, Source, Options) :-
    (   select(namespace(Start), Options, Rest) -> true
    ;   atom_concat(Source, #, Start), Rest = Options
    ),
    mindstage:rdf_register_prefix(test, Start),  % for goals that are expanded when they are loaded
    Begin = ( mindstage:rdf_register_prefix(test, Start), mindstage:owl_parse(Source) ),  % another unit may have changed it
    (   select(setup(Given), Rest, Others) -> Setup = ( Given, Begin ) ; Setup = Begin, Others = Rest ),
    load_files(library(plunit), [if(not_loaded), imports([]), silent(true)]),  % not before, for the time it takes
    plunit:begin_tests(Name, [setup(Setup)|Others]).
end_rdf_tests(Name) :- plunit:end_tests(Name).

% log_message(+Level, +Term): of KnowRob 2.
log_message(Level, Term) :- print_message(Level, mindstage_log(Term)).
log_error(Term) :- log_message(error, Term).
log_warning(Term) :- log_message(warning, Term).
log_info(Term) :- log_message(informational, Term).
log_debug(Term) :- debug(knowrob, "~p", [Term]).  % printed after debug(knowrob)

% A prefix may be registered by another file that is loaded later. Goals then keep the prefixed name, which the predicates of
% Mindstage expand when they are called.
:- wrap_predicate(rdf_prefixes:rdf_expand(Goal, _, Expanded, _), mindstage, Wrapped,
                  mindstage_user_files:expand_known(Wrapped, Goal, Expanded)).

expand_known(Wrapped, Goal, Expanded) :-
    catch(Wrapped, error(existence_error(rdf_prefix, Prefix), _), unknown_prefix(Prefix, Goal, Expanded)).

unknown_prefix(Prefix, Goal, Goal) :-
    (   warned_prefix(Prefix) -> true
    ;   assertz(warned_prefix(Prefix)),
        print_message(warning, mindstage_unknown_prefix(Prefix))
    ).

% -- module-qualified goals --------------------------------------------------------------------------------------------

% rdf_db:rdf_register_ns(...) and owl_parser:owl_parse(...) name modules of KnowRob's libraries. Goals in files of users that
% do so call the predicates of Mindstage, unless the user has a module of that name.
own_module(rdf_db).
own_module(rdfs).
own_module(owl).
own_module(t20_owl).
own_module(owl_parser).
own_module(rdfs_computable).
own_module(knowrob_owl).
own_module(rosprolog).

:- multifile system:goal_expansion/2.
:- dynamic system:goal_expansion/2.

system:goal_expansion(Goal, mindstage:Goal) :-
    prolog_load_context(module, Module),  % of a goal Module:Goal
    mindstage_user_files:own_module(Module),
    callable(Goal),
    mindstage_user_files:is_replaced_goal(Module, Goal).

is_replaced_goal(Module, Goal) :-
    (   prolog_load_context(source, Source) -> \+ of_swi_prolog(Source), \+ of_mindstage(Source) ; true ),
    \+ ( module_property(Module, file(File)), \+ of_swi_prolog(File) ),
    functor(Goal, Name, Arity),
    functor(General, Name, Arity),
    predicate_property(mindstage:General, defined),
    \+ predicate_property(mindstage:General, built_in).

of_mindstage(Source) :-
    module_property(mindstage_user_files, file(Own)),
    file_directory_name(Own, Folder),
    sub_atom(Source, 0, _, _, Folder).

% -- messages ----------------------------------------------------------------------------------------------------------

:- multifile prolog:message//1.

prolog:message(mindstage_missing_library(Name, Reason)) -->
    [ 'library(~q) is not loaded: ~w. Goals that call its predicates throw an error.'-[Name, Reason] ].
prolog:message(mindstage_covered_library(Name, all)) --> !,
    [ 'library(~q) of KnowRob is not loaded: Mindstage has its own predicates in place of most of those in it. '-[Name],
      'Goals that call any other throw an error.'-[] ].
prolog:message(mindstage_covered_library(Name, Absent)) -->
    { atomic_list_concat(Absent, ', ', Names) },
    [ 'library(~q) of KnowRob is not loaded; of what is imported, Mindstage does not have ~w'-[Name, Names] ].
prolog:message(mindstage_missing_package(Package)) -->
    [ 'the ROS package ~q is neither beside this file nor among the packages of the knowledge base; '-[Package],
      'give its folder with --ontology, or put it beside the package of this file'-[] ].
prolog:message(mindstage_missing_predicate(Procedure, Reason)) -->
    [ '~q cannot be called: ~w'-[Procedure, Reason] ].
prolog:message(mindstage_missing_directory(File)) --> [ '~w does not exist, and is not loaded'-[File] ].
prolog:message(mindstage_missing_interface(Spec)) -->
    [ 'the interface ~q is neither beside this file nor in its package; its predicates are not exported'-[Spec] ].
prolog:message(mindstage_log(Term)) --> [ '~p'-[Term] ].
prolog:message(mindstage_missing_object(Message)) -->
    [ 'a library of machine code is not loaded, and its predicates are unknown: ~w'-[Message] ].
prolog:message(mindstage_unknown_prefix(Prefix)) -->
    [ 'the prefix ~q is unknown here; register it with rdf_register_prefix/2 before its names are used'-[Prefix] ].
prolog:message(mindstage_source_not_loaded(Source, Sentence)) --> [ '~w is not loaded: ~w'-[Source, Sentence] ].
